"""Roads to less drag: every controller that was tried, from the same phases of the same wake, in one table.

    python -m benchmarks roads [NAME ...] [--json FILE]

Makes the rows of the named roads, all of them without a name; rows of other roads that are in the file already stay.
Without control for 25 t_c, then 100 with it, of which the last 60 count, averaged over whole shedding cycles. What a
road tunes or learns is kept in a folder of its own, so that a stopped measurement goes on; to make a road again, delete
its folder.
"""

import json
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from benchmarks.common.command_line import JsonFile, Parts, console, save, track
from benchmarks.roads.coarse import coarse
from benchmarks.roads.listing import ROADS
from benchmarks.roads.loop import SPANS, Setting
from benchmarks.roads.row import Row
from contract.config.loading import load_config
from contract.errors import StillwakeError
from contract.results import versions

Tree = Mapping[str, Any]


def main(
    names: Annotated[list[str] | None, typer.Argument(help="Roads to measure; all without.")] = None,
    json_file: JsonFile = None,
    parts: Parts = Path("runs/roads"),
    phases: Annotated[int, typer.Option(min=1, help="Phases of the shedding cycle that rows begin in.")] = 3,
    on_coarse: Annotated[
        bool, typer.Option("--coarse", help="On the mesh that tuning is done on, five times as fast.")
    ] = False,
    budget: Annotated[float, typer.Option(min=0.0, help="Multiplies what tuning and learning may spend.")] = 1.0,
) -> None:
    """Measure the roads, merge their rows and print the table."""
    wanted = checked(names or list(ROADS))
    config = coarse(load_config()) if on_coarse else load_config()
    # Before the work: it takes hours.
    rows = list(present(json_file))
    for name in track(wanted, "roads", "roads"):
        folder = parts / name
        folder.mkdir(parents=True, exist_ok=True)
        setting = Setting(folder=folder, config=config, phases=phases, budget=budget)
        made: Row = import_module(f"benchmarks.roads.{ROADS[name]}").measure(name, setting)
        rows = merged(rows, [made.as_tree()])
        # After each: the next one may take an hour.
        save(json_file, figures=rows, facts=_facts())
    _print(rows)


def checked(names: Sequence[str]) -> Sequence[str]:
    """The names; raises StillwakeError for one that is no road."""
    for name in names:
        if name not in ROADS:
            raise StillwakeError(f"no road {name!r}: one of {', '.join(ROADS)}")
    return names


def present(path: Path | None) -> Sequence[Tree]:
    """Rows of a results file; none if it is not there. Raises StillwakeError if it is something else."""
    if path is None or not path.exists():
        return []
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))["figures"]
        if not all(isinstance(row["road"], str) for row in rows):
            raise TypeError("a row without the name of its road")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StillwakeError(f"{path}: holds no rows of roads ({error}): name another file, or remove it") from error
    return list(rows)


def merged(before: Sequence[Tree], made: Sequence[Tree]) -> list[Tree]:
    """The rows with the new ones in place of those of the same road; in the order of `ROADS`, unknown ones last."""
    by_name = {row["road"]: row for row in (*before, *made)}
    order = list(ROADS)
    return sorted(by_name.values(), key=lambda row: order.index(row["road"]) if row["road"] in ROADS else len(order))


def _facts() -> Tree:
    return {
        "lead_in": SPANS.lead_in,
        "controlled": SPANS.controlled,
        "settle": SPANS.settle,
        "versions": versions("stillwake", "numpy", "scipy", "numba", "onnxruntime"),
    }


def _print(rows: Sequence[Tree]) -> None:
    table = Table("road", "less drag, %", "from .. to", "Cd", "mean |Cl|", "rms action", "net, %", "periods")
    for row in rows:
        table.add_row(
            row["title"],
            f"{row['reduction_percent']:.1f}",
            f"{row['least_reduction_percent']:.1f} .. {row['most_reduction_percent']:.1f}",
            f"{row['Cd']:.3f}",
            f"{row['abs_Cl']:.3f}",
            f"{row['rms_action']:.4f}",
            f"{row['net_reduction_percent']:.1f}",
            f"{row['interactions']:,}",
        )
    console.print(table)
