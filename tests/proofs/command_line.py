"""What the commands of the proofs share: where figures go, how far they are, and work in several processes.

`python -m tests.proofs.ecu`, for example, lists the proofs of its folder; pytest runs short ones of each. Work is
shared among fresh processes, and an error or a stop ends them.
"""

import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import typer

from contract.results import write_result
from stillwake.console.endings import status_of
from stillwake.console.stopping import ends_like_ctrl_c
from stillwake.console.terminal import make_console, progress_bar

S = TypeVar("S")
T = TypeVar("T")

console: Final = make_console()
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the figures and their settings here, too.")]
Processes = Annotated[int, typer.Option("--processes", min=1, help="At the same time.")]


def main(proofs: Mapping[str, Callable[..., None]]) -> None:
    """Run the proof that the command line names, with its options; ends as `stillwake` does."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, no_args_is_help=True)
    app.callback()(lambda: None)
    for name, proof in proofs.items():
        app.command(name)(proof)
    ends_like_ctrl_c()
    raise SystemExit(status_of(app))


def track(items: Iterable[T], label: str, unit: str, total: int | None = None) -> Iterator[T]:
    """The items, with progress: a bar, or lines where there is no terminal."""
    total = len(items) if total is None and isinstance(items, Sized) else total
    with progress_bar(unit, estimate_over=3600.0, console=make_console(stderr=True)) as bar:
        task = bar.add_task(label, total=total, note="")
        for done, item in enumerate(items, start=1):
            yield item
            bar.update(task, completed=done)


def spread(work: Callable[[S], T], items: Iterable[S], processes: int) -> Iterator[T]:
    """The results of the work on each item, in order."""
    if processes == 1:
        yield from map(work, items)
        return
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        yield from pool.imap(work, items)


def save(json_file: Path | None, *, figures: Any, facts: Mapping[str, Any]) -> None:
    """Write what was measured today, if a file was asked for."""
    if json_file is not None:
        write_result(json_file, figures=figures, facts=facts, on=date.today())
