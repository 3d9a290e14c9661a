"""The tables of the campaign: whether the loop is safe, and control useful, under every disturbance."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table

FILE: Final = "campaign.json"
MISSING: Final = "Not measured yet: the command above writes the file from which this table is made."


def tables(results: Path) -> dict[str, str]:
    """Return the text of each table, by the table's name in the pages; without results of a campaign, the text is a
    note."""
    path = results / FILE
    if not path.is_file():
        return {"campaign": MISSING}
    return {"campaign": campaign(read(path))}


def campaign(found: Mapping[str, Any], *, told: bool = False) -> str:
    """Return the matrix with a row per scenario. With `told`, a column contains the scenarios' sentences. A sentence is
    left out if the scenario's name differs from the previous name only in a number or a sensor."""
    rows: list[Sequence[object]] = []
    kind = ""
    for row in found["figures"]:
        before, kind = kind, re.sub(r"[\d.]+|(?:upper|lower|base)_\d+", "", row["name"])
        rows.append(
            (
                row["name"],
                *(["" if kind == before else row["sentence"]] * told),
                row["use"] if row["safe"] else f"**UNSAFE**, {row['use']}",
                _spread(row, "reduction_percent", ".1f"),
                _number(row["abs_Cl"], ".2f"),
                _in_control(row),
            )
        )
    heads = ("scenario", *(["sentence"] * told), "use", "less drag, %", "mean abs Cl", "in control, % (latched)")
    facts, figures = found["facts"], found["figures"]
    safe = sum(row["safe"] for row in figures)
    return f"""{table(heads, rows)}

Measured on {found["date"]} with {facts["bundle_name"]}: means of {facts["phases"]} starting phases, with the smallest
and largest value. If the last column is empty, the ECU was always in control; brackets contain the number of starts in
which a fault latched. Control lasts {facts["controlled"]:g} t_c; averages are over the last
{facts["controlled"] - facts["settle"]:g} t_c. {safe} of {len(figures)} scenarios are safe."""


def _in_control(row: Mapping[str, Any]) -> str:
    """Return the percentage of periods in control, or "" if it is 100, and the number of latched faults unless it is
    0."""
    share = _number(row["in_control_percent"], ".0f")
    return f"{share} ({row['latches']})" if row["latches"] else "" if share == "100" else share


def _spread(row: Mapping[str, Any], name: str, style: str) -> str:
    mean, least, most = (_number(row[f"{name}{ending}"], style) for ending in ("", "_min", "_max"))
    return mean if least == most else f"{mean} ({least}..{most})"


def _number(value: float | None, style: str) -> str:
    return "-" if value is None else f"{value:{style}}"
