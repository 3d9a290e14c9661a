"""The code that the measurements' command lines share: options, the consoles for tables and for progress, and the
output of figures."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import typer

from contract.shipped import MODEL as SHIPPED
from stillwake.console.outputs import save_json
from stillwake.console.progress import progress
from stillwake.console.terminal import make_console

T = TypeVar("T")

console: Final = make_console()
"""Console for tables; its output can be redirected."""
bars: Final = make_console(stderr=True)
"""Console for progress bars; its output is not part of the result."""

JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the figures and their settings here, too.")]
Model = Annotated[
    Path, typer.Option("--model", help="Model folder written by `stillwake train`; default: the shipped one.")
]
Dataset = Annotated[Path, typer.Option("--dataset", help="Recording to take windows from.")]
Parts = Annotated[Path, typer.Option("--parts", help="Folder of finished parts; a stopped run continues.")]

save: Final = save_json


def report(json_file: Path | None, figures: Any, facts: Mapping[str, Any], *tables: Callable[[Any], str]) -> None:
    """Write the figures to the file with `save`, and print the tables that the documents make from these figures."""
    found = {"date": date.today().isoformat(), "figures": figures, "facts": facts}
    for made in tables:
        console.print(made(found), markup=False, highlight=False, soft_wrap=True)
    save(json_file, figures=figures, facts=facts)


MODEL: Final = SHIPPED
"""Folder of the model from which the shipped bundle was exported."""


def track(items: Iterable[T], label: str, unit: str, total: int | None = None) -> Iterator[T]:
    """Yield the items and show the progress, as a bar in a terminal, otherwise as lines."""
    total = len(items) if total is None and isinstance(items, Sized) else total
    # An item may take minutes, so the remaining time is estimated from the last hour.
    with progress(unit, estimate_over=3600.0, console=bars) as report:
        report(label, 0, total)
        for done, item in enumerate(items, start=1):
            yield item
            report(label, done, total)
