"""A campaign's rows as tables: the matrix for people, and CSV for programs."""

import csv
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Final

from contract.atomic import replacing
from firmware_sim.campaign.judgement import Row, Spread
from firmware_sim.campaign.scenario import UNDISTURBED

HEADS: Final = ("scenario", "safe", "use", "less drag, %", "mean |Cl|", "in control, %", "latched")
"""Heads of `cells`."""


def cells(row: Row) -> tuple[str, ...]:
    """A row of the matrix in words, by `HEADS`."""
    return (
        row.scenario.name,
        "safe" if row.safe else "UNSAFE",  # a word needs no colour
        row.use.value,
        spread(row.reduction, ".1f"),
        spread(row.abs_Cl, ".2f"),
        number(row.in_control, ".0f"),
        str(row.latches) if row.latches else "",
    )


def spread(value: Spread, style: str) -> str:
    """Mean (least to most); the mean alone where all phases agree or there is one."""
    mean, least, most = (number(one, style) for one in (value.mean, value.least, value.most))
    return mean if least == most else f"{mean} ({least} to {most})"


def number(value: float, style: str) -> str:
    """A number in that format; a dash where there is none."""
    return f"{value:{style}}" if isfinite(value) else "-"


def headline(rows: Sequence[Row]) -> str:
    """The campaign in a sentence."""
    safe = sum(row.safe for row in rows)
    disturbed = [row for row in rows if row.scenario.name != UNDISTURBED]
    uses = [sum(row.use == use for row in disturbed) for use in ("useful", "marginal", "none")]
    look = " One start: a look, not a figure." if rows and all(len(row.phases) == 1 for row in rows) else ""
    unsafe = ", ".join(row.scenario.name for row in rows if not row.safe)
    ending = f"; UNSAFE: {unsafe}" if unsafe else ""
    use = f"under disturbance {uses[0]} useful, {uses[1]} marginal, {uses[2]} of no use"
    return f"{safe} of {len(rows)} scenarios safe; {use}{ending}.{look}"


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Write every figure of every row, whole or not at all; a figure that does not exist is empty."""
    figures = [row.figures() for row in rows]
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(figures[0])
        for row in figures:
            writer.writerow(
                ["; ".join(_listed(value)) if isinstance(value, list | dict) else value for value in row.values()]
            )


def _listed(value: list[str] | dict[str, int]) -> list[str]:
    return value if isinstance(value, list) else [f"{name} {count}" for name, count in value.items()]
