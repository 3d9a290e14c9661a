"""The commands that prepare flows: the developed wake, and the steady one."""

from datetime import date
from pathlib import Path
from typing import Annotated

import typer

from contract.config.loading import load_config
from stillwake.terminal import ConfigFile, JsonFile, Overrides, console, progress_bar


def develop(
    output: Annotated[Path, typer.Argument(help="State file to write (.npz).")],
    duration: Annotated[float, typer.Option(help="Settling time, t_c.")] = 200.0,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Start the flow from rest and let the wake establish itself: how the shipped start was made."""
    from wake.truck.develop import develop as develop_wake
    from wake.truck.truck_wake import TruckWake, save_state

    wake = TruckWake(load_config(config_file, overrides).flow)
    with progress_bar("t_c") as bar:
        task = bar.add_task("developing", total=duration, note="")
        develop_wake(wake, duration, lambda t, _: bar.update(task, completed=round(t, 1)))
    save_state(output, wake)
    console.print(f"wrote {output}")


def steady(
    output: Annotated[Path, typer.Argument(help="State file to write (.npz).")],
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Let the wake settle with shedding suppressed by symmetry: the bound on what suppressing it can save."""
    from wake.truck.steady import write_steady

    flow = load_config(config_file, overrides).flow
    with progress_bar("decades") as bar:
        task = bar.add_task("settling", total=None, note="")
        found = write_steady(output, flow, json_file, date.today(), lambda state: bar.update(task, **state))
    console.print("  ".join(f"{name} {value:.4g}" for name, value in found.figures().items()), f"\nwrote {output}")
