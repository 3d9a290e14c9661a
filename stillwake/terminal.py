"""What every command shares: the console, the progress bar with its estimate, and the options for settings."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

console = Console()

ConfigFile = Annotated[Path | None, typer.Option("--config", help="TOML file; default: the release settings.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Also write the figures and their settings here.")]
Overrides = Annotated[list[str], typer.Option("--set", help="Override, e.g. --set mpc.weights.lift=0.1 (repeatable).")]


def progress_bar(unit: str, *, estimate_over: float = 30.0) -> Progress:
    """Tasks with a bar, a count in `unit`, the field `note`, and the time left, from the speed over the last
    `estimate_over` seconds.
    """
    return Progress(
        TextColumn("[bold]{task.description}"),
        BarColumn(bar_width=12),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn(compact=True, elapsed_when_finished=True),
        TextColumn("{task.fields[note]}"),
        console=console,
        speed_estimate_period=estimate_over,
    )
