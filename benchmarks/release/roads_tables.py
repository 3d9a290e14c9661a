"""The table of the roads to less drag."""

from pathlib import Path
from typing import Any

from benchmarks.common.markdown import read, table

_HEADS = (
    *("road", "kind", "less drag, %", "from .. to", "Cd", "mean abs Cl", "mean Cl", "rms action", "jet power"),
    *("less net drag, %", "sensors", "loop", "interactions", "training, min", "step, ms", "ms on M7", "phases", "note"),
)

_DEFAULT_MESH = (443, 164)


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    rows = read(results / "roads.json")["figures"]
    free = next((row["abs_Cl"] for row in rows if row["road"] == "no-control"), float("inf"))
    return {"roads": table(_HEADS, [_cells(row, free) for row in rows]), "environment": _environment(rows)}


def _environment(rows: list[dict[str, Any]]) -> str:
    """What the environment gives a policy: the rows of its own mesh that know no more of the flow than it shows."""
    known = [row for row in rows if tuple(row["mesh"]) == _DEFAULT_MESH and row["kind"] != "oracle"]
    heads = ("policy", "mean reward", "mean `Cd_net`", "mean abs Cl", "mean Cl", "mean `jet_power`", "sensors", "steps")
    return table(
        heads,
        [
            (
                row["title"],
                f"{-row['Cd']:.3f}",
                f"{row['Cd_net']:.3f}",
                f"{row['abs_Cl']:.3f}",
                f"{row['mean_Cl']:+.3f}",
                f"{row['jet_power']:.3f}",
                row["sensors"],
                f"{row['interactions']:,}",
            )
            for row in sorted(known, key=lambda row: float(row["Cd"]), reverse=True)
        ],
    )


def _cells(row: dict[str, Any], abs_cl_uncontrolled: float) -> tuple[object, ...]:
    several = row["phases"] > 1
    mesh = "" if tuple(row["mesh"]) == _DEFAULT_MESH else f"mesh {row['mesh'][0]} x {row['mesh'][1]}; "
    start = "" if row["start"] == "developed" else f"from the {row['start']} wake; "
    trouble = "".join(sorted({f"{one['trouble']}; " for one in row["outcomes"] if one["trouble"]}))
    # The wake of a coarser mesh sheds up to a tenth harder.
    bent = "side force above the uncontrolled one; " if row["abs_Cl"] > 1.1 * abs_cl_uncontrolled else ""
    seeds = f"seeds {', '.join(str(seed) for seed in row['seeds'])}; " if row["seeds"] else ""
    return (
        row["title"],
        row["kind"],
        f"{row['reduction_percent']:.1f}",
        f"{row['least_reduction_percent']:.1f} .. {row['most_reduction_percent']:.1f}" if several else None,
        f"{row['Cd']:.3f}",
        f"{row['abs_Cl']:.3f}",
        f"{row['mean_Cl']:+.3f}",
        f"{row['rms_action']:.4f}",
        f"{row['jet_power']:.3f}",
        f"{row['net_reduction_percent']:.1f}",
        row["sensors"],
        row["loop"],
        f"{row['interactions']:,}",
        _number(row["training_minutes"], "{:.0f}"),
        _number(row["step_ms"], "{:.2f}"),
        _number(row["m7_ms"], "{:.2f}"),
        row["phases"],
        f"{mesh}{start}{seeds}{bent}{trouble}{row['note']}",
    )


def _number(value: float | None, form: str) -> str | None:
    if value is None:
        return None
    return "< 0.01" if 0.0 < value < 0.005 else form.format(value)
