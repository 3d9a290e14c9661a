"""The table that compares several ways to reduce drag."""

from pathlib import Path
from typing import Any

from benchmarks.common.markdown import read, table

_HEADS = ("road", "less drag, %", "mean abs Cl", "jet power", "less net drag, %", "steps", "loop", "starts")

_DEFAULT_MESH = (443, 164)


def tables(results: Path) -> dict[str, str]:
    """Return the text of each table, by the table's name in the pages."""
    rows = [_cells(row) for row in read(results / "roads.json")["figures"]]
    return {"roads": table(_HEADS, [*rows, _release(results)])}


def _release(results: Path) -> tuple[object, ...]:
    found = read(results / "release_loop.json")
    spread = found["figures"]["over_phases"]
    drag = spread["reduction_percent"]
    names = ("abs_Cl_controlled", "jet_power_controlled", "net_reduction_percent")
    lift, power, net = (spread[name]["mean"] for name in names)
    starts = len(found["figures"]["phases"])
    return (
        f"the shipped release ({found['facts']['bundle']})",
        f"{drag['mean']:.1f} ({drag['least']:.1f} to {drag['most']:.1f})",
        *(f"{lift:.3f}", f"{power:.3f}", f"{net:.1f}", "", "bus", starts),
    )


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
