"""What the benchmarks' command lines share: options, the two consoles, and where figures go."""

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console

from contract.results import write_result

console: Final = Console()
"""Tables, for whoever reads or redirects them."""
progress: Final = Console(stderr=True)
"""Bars, which are no part of the result."""

JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the figures and their settings here, too.")]
Model = Annotated[Path, typer.Option("--model", help="Model folder written by `stillwake train`.")]
Dataset = Annotated[Path, typer.Option("--dataset", help="Recording to take windows from.")]
Parts = Annotated[Path, typer.Option("--parts", help="Folder of finished parts; a stopped run continues.")]

MODEL: Final = Path("runs/model")
"""Where `make retrain` writes its model."""


def save(json_file: Path | None, *, figures: Any, facts: Mapping[str, Any]) -> None:
    """Write what was measured today, if a file was asked for."""
    if json_file is not None:
        write_result(json_file, figures=figures, facts=facts, on=date.today())
