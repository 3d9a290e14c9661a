"""The texts of a campaign: plan and results for the terminal and the report, and results as CSV for other programs."""

import csv
from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from math import isfinite
from pathlib import Path
from typing import Final

from contract.atomic import replacing
from firmware_sim.campaign.judgement import ScenarioRow, Spread
from firmware_sim.campaign.scenario import UNDISTURBED, Criteria, Scenario


def listing(scenarios: Sequence[Scenario], *, phases: int) -> list[str]:
    """Return the plan, one line per scenario."""
    lines = [
        f"{len(scenarios)} scenarios, from {phases} starting phase{'' if phases == 1 else 's'} each.",
        "Safe, always required: no invariant of the ECU and the vehicle breaks in any period.",
        f"Useful, unless a scenario has its own rule: {criteria_text(Criteria())}.",
    ]
    for title, group in groupby(scenarios, key=lambda one: one.group):
        lines += ["", title]
        for one in group:
            lines.append(f"  {one.name}: {one.sentence}")
            if parts := [*one.disturb, *(f"--set {text}" for text in one.settings)]:
                lines.append(f"      {'  '.join(parts)}")
            if one.criteria != Criteria():
                lines.append(f"      useful: {criteria_text(one.criteria)}")
    return lines


def criteria_text(criteria: Criteria) -> str:
    """Describe when an outcome is useful, marginal or of no use."""
    return (
        f"at least {criteria.useful:g} of the undisturbed drag reduction, and mean |Cl| at most {criteria.abs_Cl:g} of "
        f"its value without control; marginal: more than {criteria.marginal:g} of that reduction; otherwise none"
    )


MATRIX_HEADS: Final = ("scenario", "safe", "use", "less drag, %", "mean |Cl|", "in control, %", "latched")
"""Column heads for the texts that `cells` returns."""


def cells(row: ScenarioRow) -> tuple[str, ...]:
    """Return the cells of a row as text, in the order of `MATRIX_HEADS`."""
    return (
        row.scenario.name,
        "safe" if row.safe else "UNSAFE",  # in capitals, because the terminal may have no colour
        row.use.value,
        spread(row.reduction, ".1f"),
        spread(row.spread("abs_Cl"), ".2f"),
        number(row.in_control, ".0f"),
        str(row.total("latches") or ""),
    )


def spread(value: Spread, style: str) -> str:
    """Format a spread as "mean (minimum to maximum)", or as the mean if the values of all phases are equal."""
    mean, least, most = (number(one, style) for one in (value.mean, value.least, value.most))
    return mean if least == most else f"{mean} ({least} to {most})"


def number(value: float, style: str) -> str:
    return f"{value:{style}}" if isfinite(value) else "-"


def headline(rows: Sequence[ScenarioRow]) -> str:
    safe = sum(row.safe for row in rows)
    uses = Counter(str(row.use) for row in rows if row.scenario.name != UNDISTURBED)
    look = " One start: no more than an impression." if rows and all(len(row.phases) == 1 for row in rows) else ""
    unsafe = ", ".join(row.scenario.name for row in rows if not row.safe)
    ending = f"; UNSAFE: {unsafe}" if unsafe else ""
    use = f"under disturbance {uses['useful']} useful, {uses['marginal']} marginal, {uses['none']} of no use"
    return f"{safe} of {len(rows)} scenarios safe; {use}{ending}.{look}"


def write_csv(path: Path, rows: Sequence[ScenarioRow]) -> None:
    """Write every figure of every row to a CSV file, completely or not at all; a missing figure is empty."""
    figures = [row.figures() for row in rows]
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(figures[0])
        for row in figures:
            row["not_in_control_reasons"] = [f"{name} {count}" for name, count in row["not_in_control_reasons"].items()]
            writer.writerow(["; ".join(value) if isinstance(value, list) else value for value in row.values()])
