"""The commands that prepare flows: the developed wake, and the steady one."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Final

import typer

from contract.results import versions
from stillwake.console.numbers import steps_of
from stillwake.console.outputs import Overwrite, check_json, check_output, save_json
from stillwake.console.settings import settings
from stillwake.console.terminal import ConfigFile, JsonFile, Overrides, console, progress_bar

USES: Final = ("flow", "body")
"""Settings of a plant without forcing or control."""


def develop(
    output: Annotated[Path, typer.Argument(help="State file to write (.npz).")],
    duration: Annotated[float, typer.Option(help="Settling time, t_c.")] = 200.0,
    overwrite: Overwrite = False,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Start the flow from rest and run it until the wake sheds; write its state, for runs to begin from.

    The shipped start was made in this way. `run --start`, `record --start` and
    `picture --state` begin from such a file. Another Reynolds number or body
    needs one of its own, with the same settings in both commands, for example
    --set flow.reynolds=1000.
    """
    config = settings("develop", config_file, overrides, uses=USES).config
    steps_of("--duration", duration, config.flow.control_period)
    check_output(output, overwrite=overwrite)

    from wake.truck.develop import develop as develop_wake
    from wake.truck.state import save_state
    from wake.truck.truck_wake import TruckWake

    wake = TruckWake(config.flow, body=config.body)
    with progress_bar("t_c") as bar:
        task = bar.add_task("developing", total=duration, note="")
        state = develop_wake(wake, duration, lambda t, _: bar.update(task, completed=round(t, 1)))
    save_state(output, state)
    console.print(f"wrote {output}")


def steady(
    output: Annotated[Path, typer.Argument(help="State file to write (.npz).")],
    overwrite: Overwrite = False,
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Compute the flow with its two halves held symmetric, so that no vortices are shed, until it is steady.

    Its drag is the least that a controller can reach by suppressing the
    shedding alone.
    """
    config = settings("steady", config_file, overrides, uses=USES).config
    check_output(output, overwrite=overwrite)
    check_json(json_file)

    from stillwake.console.settling import settle_into

    settled, grid = settle_into(output, config)
    figures = settled.figures()
    facts = {
        "config": asdict(config.flow),
        "body": asdict(config.body),
        "grid": list(grid),
        "versions": versions("numpy", "numba", "scipy"),
    }
    save_json(json_file, figures=figures, facts=facts)
    console.print("  ".join(f"{name} {value:.4g}" for name, value in figures.items()), f"\nwrote {output}")
