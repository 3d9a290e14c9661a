"""The command that makes a linear controller of a recording."""

from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from contract.config.loading import to_tree
from contract.model.linear_model_folder import check_free
from contract.shipped import recording as shipped_recording
from stillwake.console.outputs import Overwrite, check_json, check_output, save_json
from stillwake.console.settings import settings
from stillwake.console.terminal import ConfigFile, JsonFile, Overrides, console, phases_bar, print_table

if TYPE_CHECKING:
    # Loading scipy takes time, which the other commands need not wait for.
    from train.linear.pipeline import Identified

USES: Final = ("flow", "mpc", "operating_point", "ecu.compute_time_ms")
"""Settings that the model keeps for its export."""


def identify(
    output: Annotated[Path, typer.Argument(help="Linear model directory to write.")],
    dataset: Annotated[Path | None, typer.Option(help="HDF5 data set; default: the shipped recording.")] = None,
    episodes: Annotated[
        str, typer.Option(help="Comma-separated names of episodes to use; * stands for anything.")
    ] = "controlled*",
    leave_out: Annotated[int, typer.Option(help="Control steps at an episode's start that are not used.")] = 500,
    window: Annotated[int, typer.Option(help="Memory of model and controller, in control steps.")] = 64,
    ridge: Annotated[float, typer.Option(help="Of the regression, on regressors scaled to 1.")] = 1e-3,
    held_out: Annotated[float, typer.Option(help="Last part of each episode, to judge on.")] = 0.25,
    fastest: Annotated[
        float, typer.Option(help="Refuse a model with a mode that grows by more e-foldings in t_c.")
    ] = 1.0,
    action_weight: Annotated[float, typer.Option(help="On the square of the action in U_inf W.")] = 100.0,
    difference_weight: Annotated[float, typer.Option(help="On the square of each pressure difference in Cp.")] = 10.0,
    lift_weight: Annotated[float, typer.Option(help="On the square of Cl.")] = 1.0,
    probe_weight: Annotated[
        float, typer.Option(help="On the square of the recorded transverse velocity behind the body; 0 needs none.")
    ] = 1.0,
    sensors: Annotated[
        str, typer.Option(help="Comma-separated pairs: a sensor, its mirror image, and so on.")
    ] = "upper_39,lower_39,base_0,base_9",
    overwrite: Overwrite = False,
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Make a linear controller of a recording: an autoregressive model by regression, and a regulator on it.

    It takes seconds, needs no PyTorch, and is the cheapest controller for a
    microcontroller. `export` turns the folder into a bundle and a C library,
    as it does with a trained model.
    docs/how-to/identify-a-linear-controller.md describes its uses.
    """
    # A missing extra is reported before missing data.
    from train.linear.pipeline import PHASES, Design, Identification, identify_all

    config = settings("identify", config_file, overrides, uses=USES).config
    recording = shipped_recording() if dataset is None else dataset
    check_free(output)
    check_output(output, overwrite=overwrite, folder=True, occupant="there is a model already")
    check_json(json_file)

    how = Identification(
        episodes=_names(episodes),
        leave_out=leave_out,
        window=window,
        ridge=ridge,
        held_out=held_out,
        fastest=fastest,
        sensors=_names(sensors),
    )
    weights = Design(action=action_weight, differences=difference_weight, lift=lift_weight, probe=probe_weight)
    with phases_bar("identify", PHASES) as (_, phase):
        done = identify_all(recording, output, config, how, weights, phase=phase)
    _print(done)
    save_json(
        json_file,
        figures=done.as_metrics(),
        facts={
            "dataset_sha256": sha256(recording.read_bytes()).hexdigest(),
            "identification": asdict(how),
            "design": asdict(weights),
            "config": to_tree(config),
            "versions": done.versions,
        },
    )
    console.print(f"wrote {output}")


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _print(done: "Identified") -> None:
    ahead = (f"R2 {steps} ahead" for steps in done.r2)
    rows = ((name, *(f"{values[row]:.3f}" for values in done.r2.values())) for row, name in enumerate(done.rows))
    title = "last parts of the episodes, by a model that was fitted to the first parts"
    print_table("", *ahead, rows=rows, title=title)
    growing = "; ".join(f"{growth:.3f} at {frequency:.3f}/t_c" for growth, frequency in done.growing)
    facts = (
        ("fitted to", f"{done.steps} steps of {len(done.episodes)} episodes: {', '.join(done.episodes)}"),
        ("spectral radius, open loop", f"{done.open_loop:.4f}"),
        ("spectral radius, closed loop", f"{done.closed_loop:.4f}"),
        ("growing modes, e-foldings in t_c", growing or "none"),
        ("sum of gains", f"{done.gain_sum:.3g}"),
    )
    print_table("linear controller", "", rows=facts)
