"""The code that the measurements share: options, consoles, the output of figures, and the stored parts of a study."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from datetime import date
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import typer

from contract.atomic import replacing
from contract.side_by_side import process_pool
from stillwake.console.outputs import save_json
from stillwake.console.progress import progress
from stillwake.console.terminal import make_console

T = TypeVar("T")

ROOT: Final = Path(__file__).resolve().parents[2]
_OF_A_LOOP: Final = ("contract", "wake", "can_bridge", "ecu", "firmware_sim", "export")
LOOP: Final = ("Cd_controlled", "reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action")
"""Figures of `stillwake run --json` by which controllers are compared."""

console: Final = make_console()
bars: Final = make_console(stderr=True)
"""Console for progress bars; its output is not part of the result."""

JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the figures and their settings here, too.")]
Parts = Annotated[Path, typer.Option("--parts", help="Folder of finished parts, with which a stopped run continues.")]
Phases = Annotated[int, typer.Option(min=1, max=25, help="Number of starting phases in a shedding cycle.")]
Workers = Annotated[int, typer.Option(min=1, max=16, help="Number of processes for the runs.")]
Release = Annotated[Path, typer.Option(help="Another release in place of the shipped one.")]


def report(json_file: Path | None, figures: Any, facts: Mapping[str, Any], *tables: Callable[[Any], str]) -> None:
    """Write the figures to the file, unless it is None, and print the documents' tables with these figures."""
    found = {"date": date.today().isoformat(), "figures": figures, "facts": facts}
    for made in tables:
        console.print(made(found), markup=False, highlight=False, soft_wrap=True)
    save_json(json_file, figures=figures, facts=facts)


def track(items: Iterable[T], label: str, unit: str, total: int | None = None) -> Iterator[T]:
    """Yield the items and show the progress: a bar in a terminal, lines elsewhere."""
    total = len(items) if total is None and isinstance(items, Sized) else total
    # An item may take minutes, so the remaining time is estimated from the last hour.
    with progress(unit, estimate_over=3600.0, console=bars) as report:
        report(label, 0, total)
        for done, item in enumerate(items, start=1):
            yield item
            report(label, done, total)


def part(path: Path, make: Callable[[], Any]) -> Any:
    """Return the finished part stored in a file, as plain values for JSON; a missing part is computed and stored."""
    if not path.is_file():
        made = make()
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(made), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def made_from(digest: str, *folders: str) -> str:
    """Return a short hash of a release, of the sources of a closed loop, and of those in further folders."""
    everything = hashlib.sha256(digest.encode())
    for path in (path for folder in (*_OF_A_LOOP, *folders) for path in sorted((ROOT / folder).rglob("*"))):
        if path.suffix in (".py", ".c", ".h", ".toml", ".dbc"):
            everything.update(path.read_bytes())
    return everything.hexdigest()[:12]


def kept_runs(run: Callable[..., Any], runs: Mapping[Path, tuple[Any, ...]], *, workers: int, label: str) -> list[Any]:
    """Return the results of all runs, in order. `runs` maps the results file of each run to the arguments of `run`.
    Missing results are computed in `workers` processes."""
    missing = [path for path in runs if not path.is_file()]
    # A process takes seconds to start, so no process is started if all results are stored.
    if missing:
        with process_pool(min(workers, len(missing))) as pool:
            work = [partial(run, *runs[path]) for path in missing]
            list(track(pool.map(part, missing, work), label, "runs", len(missing)))
    return [json.loads(path.read_text(encoding="utf-8")) for path in runs]
