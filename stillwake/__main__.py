"""The command line: the only place that knows every room.

Rooms are imported where a command needs them, so that `run` on a vehicle needs neither torch nor a flow solver's
compiler, and a missing extra is one clear line.
"""

import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from datetime import date
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from rich.progress import TaskID
from rich.table import Table

from stillwake.commands import bundle as stillwake_bundle
from stillwake.commands import picture as stillwake_pictures
from stillwake.commands import record as stillwake_record
from contract.config_loading import load_config, to_tree
from contract.errors import StillwakeError
from contract.results import write_result
from contract.signing import public_key, read_private_key
from stillwake.terminal import ConfigFile, JsonFile, Overrides, console, progress_bar

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
errors = Console(stderr=True)

SHIPPED_RECORDING: Final = Path(str(files("wake").joinpath("data/recording.h5")))
INTERRUPTED: Final = 130
"""Exit status after Ctrl-C, as shells have it."""


@app.callback()
def _root() -> None:
    """A learned flow controller for truck wakes, from wall pressures to an ECU on the CAN bus."""


app.command()(stillwake_record.record)


@app.command()
def train(
    output: Annotated[Path, typer.Argument(help="Model directory to write.")],
    dataset: Annotated[Path | None, typer.Option(help="HDF5 data set; default: the shipped recording.")] = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    resume: Annotated[bool, typer.Option(help="Continue an interrupted training.")] = False,
    sensors: Annotated[str, typer.Option(help="Comma-separated sensors instead of the method's choice.")] = "",
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Train the model of the wake offline, from a recording.

    Joint fit (paper, section 2.2): an LSTM encoder over the last 32 rows of
    90 pressures and the action, residual latent dynamics and a force decoder,
    together, on L_pred + force_weight L_force + variance_weight L_var +
    covariance_weight L_cov, unrolled over train.unroll steps; then
    train.finish.epochs more passes, unrolled over train.finish.unroll.

    Sensor selection (2.3.1): the best train.sensors by mean |SHAP| of the
    latents, train.shap_repeats times over; or train.selection = qr, greedy,
    random or hand.

    Distillation (2.3.2): a slim encoder on those sensors learns the latents
    of the fitted one; with model.slim_dynamics_width and
    model.slim_decoder_width, narrower dynamics and decoder learn its
    roll-outs.

    All are judged on the test episodes: R2 and L1/sigma of Cd and Cl, and
    open-loop roll-outs of 5, 10 and 25 steps. Settings default to the
    release's; --config takes a TOML file, --set one value, such as
    --set train.epochs=300. Seed, recording, settings and machine decide the
    model, also if the run is stopped and resumed.
    """
    from train.pipeline import train_all

    began = time.monotonic()
    config = load_config(config_file, overrides)
    names = {
        "fit": "joint fit",
        "finish": "longer unroll",
        "rank": "SHAP ranking",
        "select": "sensor selection",
        "stream": "distil, streamed",
        "distil": "distil, windows",
        "predictor": "distil predictor",
    }
    with progress_bar("iterations") as bar:
        tasks: dict[str, TaskID] = {}

        def show(phase: str, step: int, total: int, terms: Mapping[str, float]) -> None:
            if phase not in tasks:
                tasks[phase] = bar.add_task(names.get(phase, phase), total=total, note="")
            note = "  ".join(f"{name} {value:.4f}" for name, value in terms.items())
            bar.update(tasks[phase], completed=step, note=note)

        trained = train_all(
            SHIPPED_RECORDING if dataset is None else dataset,
            config,
            output,
            progress=show,
            device=device,
            resume=resume,
            chosen=tuple(name.strip() for name in sensors.split(",")) if sensors else None,
        )
    console.print(_metrics_table(trained.metrics))
    stable = trained.ranking.get("stable", {})
    if json_file is not None:
        write_result(
            json_file,
            figures={"metrics": trained.metrics, "sensors": trained.sensors, "stable": stable},
            facts={
                "dataset_sha256": trained.dataset_sha256,
                "config": to_tree(config),
                "versions": trained.versions,
                "minutes": (time.monotonic() - began) / 60.0,
            },
            on=date.today(),
        )
    sets = ", ".join(f"{size}: {'yes' if same else 'no'}" for size, same in stable.items())
    found = f"top sets identical over the repeats: {sets}" if sets else f"method: {trained.ranking['method']}"
    console.print(f"sensors: {', '.join(trained.sensors)}   {found}")
    console.print(f"wrote {output}")


@app.command()
def export(
    model: Annotated[Path, typer.Argument(help="Model directory written by `train`.")],
    output: Annotated[Path, typer.Argument(help="Bundle directory, or .zip, to write.")],
    precision: Annotated[str, typer.Option(help="int8 (weights) or float32.")] = "int8",
    name: Annotated[str, typer.Option(help="Name of the release.")] = "truck-wake",
    dataset: Annotated[Path | None, typer.Option(help="Recording the gates are run on; default: shipped.")] = None,
    c_folder: Annotated[Path | None, typer.Option("--c", help="Also write the C99 library into this folder.")] = None,
    key: Annotated[Path | None, typer.Option(help="Sign the bundle with this private key (`bundle keygen`).")] = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Lower a trained model to one ONNX graph of a control step and pack a release bundle.

    The MPC settings come from the configuration. Nothing is written unless the graph agrees with the reference.
    """
    from export.pipeline import export_all

    signing_key = None if key is None else read_private_key(key)
    done = export_all(
        model,
        output,
        precision=precision,
        name=name,
        recording=SHIPPED_RECORDING if dataset is None else dataset,
        config=load_config(config_file, overrides),
        c_folder=c_folder,
        created=date.today(),
        key=signing_key,
    )
    table = Table("gate", "measured")
    for title, value in done.gates():
        table.add_row(title, f"{value:.3g}" if isinstance(value, float) else str(value))
    console.print(table)
    signed = "unsigned" if signing_key is None else f"signed by key {public_key(signing_key).fingerprint}"
    size = f"controller.onnx {done.release.controller_bytes / 1024:.0f} KiB"
    console.print(f"wrote {output}: {precision}, {size}, {signed}", soft_wrap=True)
    if done.library is not None:
        console.print(f"wrote {c_folder}: C99, {precision}, {done.library.workspace_bytes / 1024:.0f} KiB of workspace")


@app.command()
def mcu(
    library: Annotated[Path, typer.Argument(help="Folder written by `export --c`.")],
    json_file: JsonFile = None,
) -> None:
    """Compile the C library for a Cortex-M7, replay its recorded rows on an emulated one, compare with this host."""
    from firmware_sim.mcu.measure import measure_folder

    found = measure_folder(library)
    table = Table("one control step on a Cortex-M7", "")
    for name, value in found.rows():
        table.add_row(name, value)
    console.print(table)
    if json_file is not None:
        write_result(json_file, figures=asdict(found), facts={"library": str(library)}, on=date.today())


@app.command()
def run(
    output: Annotated[Path, typer.Argument(help="Run folder to write.")],
    bundle: Annotated[Path | None, typer.Option(help="Release bundle; default: the shipped one.")] = None,
    trust: stillwake_bundle.Trust = None,
    library: Annotated[
        Path | None, typer.Option(help="Run this C library of the bundle's (`export --c`) in place of ONNX Runtime.")
    ] = None,
    lead_in: Annotated[float, typer.Option(help="Time without control, t_c.", min=0.2)] = 25.0,
    controlled: Annotated[float, typer.Option(help="Time with control, t_c.", min=0.2)] = 100.0,
    settle: Annotated[float, typer.Option(help="Left out of the controlled averages, t_c.", min=0.0)] = 40.0,
    plant: Annotated[str, typer.Option(help="stillwake (own solver) or openfoam (icoFoam; far slower).")] = "stillwake",
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Close the loop: live wake, pressures on CAN, the bundle's controller on the ECU, jets; in virtual time."""
    from can_bridge.messages import Mode
    from firmware_sim.closed_loop import SUMMARY, run_closed_loop, summary
    from firmware_sim.library_controller import LibraryController
    from firmware_sim.plants import open_plant
    from firmware_sim.report import drag_rows, headline, service_rows, write_report
    from firmware_sim.run_log import Row

    config = load_config(config_file, overrides)
    release = stillwake_bundle.open_release(bundle, trust)
    if plant not in ("stillwake", "openfoam"):
        raise StillwakeError(f"--plant {plant}: must be stillwake or openfoam")
    console.print(*stillwake_bundle.headline(release), sep="\n", soft_wrap=True)
    controller = None
    if library is not None:
        controller = LibraryController(library, release)
        console.print(f"library {library}: {controller.description}", soft_wrap=True, markup=False)
    with progress_bar("periods") as bar:
        task = bar.add_task("closed loop", total=None, note="")

        def show(row: Row, done: int, total: int) -> None:
            note = (
                f"{Mode(row.mode).name:7s} Cd {row.Cd:.3f}  base Cp {row.base_Cp:+.3f}  "
                f"action {row.action:+.3f}  step {row.step_ms:.1f} ms"
            )
            bar.update(task, completed=done, total=total, note=note)

        def show_start(t: float, total: float) -> None:
            bar.update(task, completed=round(t, 1), total=total, note="t_c of the wake's development", refresh=True)

        flow = open_plant(
            "openfoam" if plant == "openfoam" else "stillwake", output, config, lead_in + controlled, show_start
        )
        log = run_closed_loop(
            output,
            release,
            config,
            lead_in=lead_in,
            controlled=controlled,
            settle=settle,
            progress=show,
            plant=flow,
            controller=controller,
        )
    page = write_report(output)
    if json_file is not None:
        write_result(json_file, figures=summary(log), facts=log.facts, on=date.today())
    table = Table("", "uncontrolled", "controlled")
    for label, before, under in drag_rows(log):
        table.add_row(label, before, under)
    service = Table("bus and ECU", "")
    for label, value in service_rows(log):
        service.add_row(label, value)
    for item in (table, service, headline(log), f"wrote {page} and {output / SUMMARY}"):
        console.print(item)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(help="Folder written by `run`.")],
    picture: Annotated[Path | None, typer.Option(help="Also write the run as one PNG here.")] = None,
) -> None:
    """Write a run's HTML page anew from its series."""
    from firmware_sim.report import write_picture, write_report

    console.print(f"wrote {write_report(folder)}")
    if picture is not None:
        write_picture(folder, picture)
        console.print(f"wrote {picture}")


@app.command()
def develop(
    output: Annotated[Path, typer.Argument(help="State file to write (.npz).")],
    duration: Annotated[float, typer.Option(help="Settling time, t_c.")] = 200.0,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Start the flow from rest and let the wake establish itself: how the shipped start was made."""
    from wake.develop import develop as develop_wake
    from wake.truck_wake import TruckWake, save_state

    wake = TruckWake(load_config(config_file, overrides).flow)
    with progress_bar("t_c") as bar:
        task = bar.add_task("developing", total=duration, note="")
        develop_wake(wake, duration, lambda t, _: bar.update(task, completed=round(t, 1)))
    save_state(output, wake)
    console.print(f"wrote {output}")


@app.command()
def steady(
    output: Annotated[Path, typer.Argument(help="State file to write (.npz).")],
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Let the wake settle with shedding suppressed by symmetry: the bound on what suppressing it can save."""
    from wake.steady import write_steady

    flow = load_config(config_file, overrides).flow
    with progress_bar("decades") as bar:
        task = bar.add_task("settling", total=None, note="")
        found = write_steady(output, flow, json_file, date.today(), lambda state: bar.update(task, **state))
    console.print("  ".join(f"{name} {value:.4g}" for name, value in found.figures().items()), f"\nwrote {output}")


app.add_typer(stillwake_bundle.bundle, name="bundle")
app.add_typer(stillwake_pictures.picture, name="picture")
app.command()(stillwake_pictures.animate)


def _metrics_table(metrics: Mapping[str, Any]) -> Table:
    ahead = [f"h={item['horizon']}" for item in metrics["teacher"]["rollout"]]
    table = Table("Cd, Cl", "R2", "L1/sigma", *ahead, title="test episodes; h = n: L1/sigma n steps ahead")
    # "deployed" is there if dynamics and decoder were slimmed, too.
    for name in ("teacher", "slim", "deployed"):
        if (part := metrics.get(name)) is not None:
            errors_now = (f"{part['drag'][kind]:.3f} {part['lift'][kind]:.3f}" for kind in ("r2", "l1_over_sigma"))
            errors_ahead = (f"{item['drag']:.2f} {item['lift']:.2f}" for item in part["rollout"])
            table.add_row(name, *errors_now, *errors_ahead)
    return table


@contextmanager
def _one_line_errors() -> Iterator[None]:
    """Turn what a user can cause into one line and a non-zero exit."""
    try:
        yield
    except StillwakeError as error:
        errors.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(1)
    except ModuleNotFoundError as error:
        of_extra = {"train": ("torch", "shap", "onnx", "safetensors"), "mcu": ("unicorn", "capstone")}
        extra = next((extra for extra, names in of_extra.items() if error.name in names), "sim")
        line = f"error: this command needs {error.name}: pip install 'stillwake[{extra}]'"
        errors.print(line, style="red", markup=False)
        sys.exit(1)
    except SystemExit as stop:
        if stop.code == INTERRUPTED:  # typer ends by exiting, and makes this of Ctrl-C
            errors.print("stopped", style="red")
        raise


def main() -> None:
    """Entry point of the `stillwake` command."""
    with _one_line_errors():
        app()


if __name__ == "__main__":
    main()
