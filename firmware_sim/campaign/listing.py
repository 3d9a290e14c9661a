"""A test plan for readers: every scenario as a sentence, what it is made of, and when it counts as passed."""

from collections.abc import Sequence
from itertools import groupby

from firmware_sim.campaign.scenario import Criteria, Scenario


def listing(scenarios: Sequence[Scenario], *, phases: int) -> list[str]:
    """The plan, a line each."""
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
    """When an outcome is useful, marginal or none, in words."""
    return (
        f"at least {criteria.useful:g} of the undisturbed drag reduction with mean |Cl| at most {criteria.abs_Cl:g} of "
        f"that without control; marginal: more than {criteria.marginal:g} of it; otherwise none"
    )
