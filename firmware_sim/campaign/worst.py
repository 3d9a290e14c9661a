"""Which two disturbances hurt most, by rule, so that they can be combined as a campaign's last stage."""

from collections.abc import Sequence
from itertools import combinations
from math import isfinite
from typing import Final

from firmware_sim.campaign.judgement import Row
from firmware_sim.campaign.scenario import COMBINED, UNDISTURBED, Criteria, Scenario

TITLE: Final = "The two that hurt most, together"
LEAST_IN_CONTROL: Final = 90.0
"""Percent of the requested time in control. A disturbance that shuts the jets hides what any other does to them."""


def two_worst(rows: Sequence[Row]) -> Scenario | None:
    """The scenario that combines the two that left the least drag reduction while control went on.

    They are of two groups, since two of one group are often one thing in two sizes, and set no setting in common. Of
    pairs, the one with the least sum of reductions counts, the first of the plan among equals.

    Returns:
        None if there are no two such scenarios.
    """
    candidates = [
        row
        for row in rows
        if row.scenario.name not in (UNDISTURBED, COMBINED)
        and isfinite(row.reduction.mean)
        and row.in_control >= LEAST_IN_CONTROL
    ]
    pairs = [pair for pair in combinations(candidates, 2) if _go_together(*(row.scenario for row in pair))]
    if not pairs:
        return None
    one, other = (row.scenario for row in min(pairs, key=lambda pair: sum(row.reduction.mean for row in pair)))
    return Scenario(
        name=COMBINED,
        group=TITLE,
        sentence=f"{one.name} and {other.name}, the two that hurt most while control went on, at the same time.",
        disturb=(*one.disturb, *other.disturb),
        settings=(*one.settings, *other.settings),
        criteria=Criteria(),
    )


def _go_together(one: Scenario, other: Scenario) -> bool:
    set_by = [{text.partition("=")[0].strip() for text in scenario.settings} for scenario in (one, other)]
    return one.group != other.group and not set_by[0] & set_by[1]
