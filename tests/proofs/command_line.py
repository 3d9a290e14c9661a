"""What the commands of the proofs share: parts of the work in fresh processes, progress, and where figures go."""

import multiprocessing
import resource
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.table import Table

from benchmarks.common.command_line import console, track
from stillwake.console.endings import status_of
from stillwake.console.outputs import save_json
from stillwake.console.stopping import ends_like_ctrl_c

S = TypeVar("S")
T = TypeVar("T")

JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the figures and their settings here, too.")]
Processes = Annotated[int, typer.Option("--processes", min=1, help="At the same time.")]
Seed = Annotated[int, typer.Option("--seed", help="Of all that happens.", min=0)]


def main(proofs: Mapping[str, Callable[..., None]]) -> None:
    """Run the proof that the command line names, with its options; ends as `stillwake` does."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, no_args_is_help=True)
    for name, proof in proofs.items():
        app.command(name)(proof)
    ends_like_ctrl_c()
    raise SystemExit(status_of(app))


def spread(work: Callable[[S], T], items: Iterable[S], processes: int) -> Iterator[T]:
    if processes == 1:
        yield from map(work, items)
        return
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        yield from pool.imap(work, items)


def in_parts(work: Callable[[range], T], total: int, part: int, processes: int, label: str) -> Iterator[T]:
    """The results of the work on all numbers below `total`, so many at a time, in order and with progress."""
    parts = [range(start, min(start + part, total)) for start in range(0, total, part)]
    yield from track(spread(work, parts, processes), label, f"parts of {part}", len(parts))


def max_rss_kib() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def report(
    json_file: Path | None,
    title: str,
    figures: Mapping[str, Any],
    *,
    packages: Iterable[str],
    shown: Iterable[str] = (),
    **facts: Any,
) -> None:
    """Print the figures, or those of them that are `shown`, and write all with their facts if a file was asked for."""
    table = Table(title, "")
    for row in _rows("", {name: figures[name] for name in shown or figures}):
        table.add_row(*row)
    console.print(table)
    save_json(json_file, figures=figures, facts=facts, packages=tuple(packages))


def _rows(name: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _rows(f"{name} {key}".strip().replace("_", " "), inner)
    elif isinstance(value, list) and value:
        for inner in value:
            yield from _rows(name, inner)
    else:
        yield name, f"{value:.4g}" if isinstance(value, float) else str(value)
