"""The tables of the campaign: whether the loop is safe and useful under every disturbance."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table
from firmware_sim.campaign.result_figures import PAPERS_DELAYED_CD, papers_reduction_percent

FILE: Final = "campaign.json"
MISSING: Final = "Not measured yet: the command above writes the file that this table is made of."


def tables(results: Path) -> dict[str, str]:
    """Return every table by its marker; a note in its place if there are no results of a campaign."""
    path = results / FILE
    if not path.is_file():
        return {"campaign": MISSING, "campaign_paper": MISSING}
    found = read(path)
    return {"campaign": campaign(found), "campaign_paper": beside_the_paper(found["figures"])}


def campaign(found: Mapping[str, Any], *, told: bool = False) -> str:
    """Return the matrix with a row per scenario. With `told`, a column has the scenarios' sentences, but not if a
    scenario differs from the previous one only in a number or a sensor."""
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
    heads = ("scenario", *(["what is done"] * told), "use", "less drag, %", "mean abs Cl", "in control, % (latched)")
    facts, figures = found["facts"], found["figures"]
    safe = sum(row["safe"] for row in figures)
    return f"""{table(heads, rows)}

Measured on {found["date"]} with {facts["bundle_name"]} from {facts["phases"]} starting phases: means, and the least and
the most of the phases. In control all of the time where nothing stands; in brackets the starts in which a fault
latched. {facts["controlled"]:g} t_c with control, averages over the last
{facts["controlled"] - facts["settle"]:g}. {safe} of {len(figures)} scenarios are safe."""


def beside_the_paper(figures: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of drag and lift against the delay, with the paper's figures."""
    by_name = {row["name"]: row for row in figures}
    rows = []
    for delay in (0, 2, 4, 8, 12):
        compensated = by_name.get("undisturbed" if delay == 0 else f"delay_{delay}")
        uncompensated = by_name.get("undisturbed" if delay == 0 else f"delay_{delay}_uncompensated")
        if compensated is None or uncompensated is None:
            continue
        Cd = PAPERS_DELAYED_CD.get(delay)
        rows.append(
            (
                delay,
                _number(compensated["reduction_percent"], ".1f"),
                _number(compensated["abs_Cl"], ".2f"),
                _number(uncompensated["reduction_percent"], ".1f"),
                _number(uncompensated["abs_Cl"], ".2f"),
                "" if Cd is None else f"{papers_reduction_percent(Cd):.1f}",
            )
        )
    heads = ("delay, periods", "less drag, %", "mean abs Cl", "not compensated, %", "mean abs Cl", "paper, %")
    return table(heads, rows)


def _in_control(row: Mapping[str, Any]) -> str:
    """Return the share of the periods, "" for all of them, and the number of latched faults."""
    share = _number(row["in_control_percent"], ".0f")
    return f"{share} ({row['latches']})" if row["latches"] else "" if share == "100" else share


def _spread(row: Mapping[str, Any], name: str, style: str) -> str:
    mean, least, most = (_number(row[f"{name}{ending}"], style) for ending in ("", "_min", "_max"))
    return mean if least == most else f"{mean} ({least}..{most})"


def _number(value: float | None, style: str) -> str:
    return "-" if value is None else f"{value:{style}}"
