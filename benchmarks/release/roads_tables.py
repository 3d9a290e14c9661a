"""The table of the ways to reduce drag."""

from pathlib import Path
from typing import Any

from benchmarks.common.markdown import read, table

_HEADS = ("road", "less drag, %", "mean abs Cl", "jet power", "less net drag, %", "steps", "loop", "starts")

_DEFAULT_MESH = (443, 164)


def tables(results: Path) -> dict[str, str]:
    """Return every table by its marker."""
    rows = read(results / "roads.json")["figures"]
    return {"roads": table(_HEADS, [_cells(row) for row in rows])}


def _cells(row: dict[str, Any]) -> tuple[object, ...]:
    mean, least, most = (f"{row[f'{name}reduction_percent']:.1f}" for name in ("", "least_", "most_"))
    loop = "bus" if row["loop"] == "CAN" else "no bus"
    return (
        row["title"],
        mean if least == most else f"{mean} ({least} to {most})",
        f"{row['abs_Cl']:.3f}",
        f"{row['jet_power']:.3f}",
        f"{row['net_reduction_percent']:.1f}",
        f"{row['interactions']:,}",
        loop if tuple(row["mesh"]) == _DEFAULT_MESH else f"{loop}, coarse",
        row["phases"],
    )
