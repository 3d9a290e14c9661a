"""The judgement of a campaign, one row per scenario: safety, benefit of control, and variation between starting phases.
The module also writes plan and results as text for terminal and report, and as CSV for other programs."""

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import groupby
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any, Final

from contract.atomic import replacing
from firmware_sim.campaign.folder import RunOutcome, RunService
from firmware_sim.campaign.scenario import UNDISTURBED, Criteria, Scenario
from firmware_sim.runs.statistics import rounded

MATRIX_HEADS: Final = ("scenario", "safe", "use", "less drag, %", "mean |Cl|", "in control, %", "latched")
"""Column heads for the texts that `cells` returns."""


class Use(StrEnum):
    """The classes of the controller's benefit under a disturbance."""

    USEFUL = "useful"
    MARGINAL = "marginal"
    NONE = "none"


@dataclass(frozen=True, kw_only=True)
class PhaseOutcomes:
    """The runs of a scenario from one starting phase: under control, and without control in the same flow."""

    under: RunOutcome
    free: RunOutcome

    @property
    def reduction(self) -> float:
        """Reduction of the mean wall drag by control, in percent; NaN if a run did not finish."""
        if self.under.figures is None or self.free.figures is None:
            return nan
        return 100.0 * (1.0 - self.under.figures.Cd / self.free.figures.Cd)


@dataclass(frozen=True, kw_only=True)
class Spread:
    """The mean, minimum and maximum of a figure over the starting phases."""

    mean: float
    least: float
    most: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        if not values or not all(map(isfinite, values)):
            return cls(mean=nan, least=nan, most=nan)
        return cls(mean=sum(values) / len(values), least=min(values), most=max(values))


@dataclass(frozen=True, kw_only=True)
class ScenarioRow:
    """The outcome of one scenario, which is safe if the runs from all starting phases finished without a violated
    invariant. `reduction` is the reduction of wall drag in percent, relative to the run from the same starting phase
    without control; `lost` is the undisturbed scenario's mean reduction minus this one's, in percentage points."""

    scenario: Scenario
    phases: tuple[PhaseOutcomes, ...]
    safe: bool
    use: Use
    reduction: Spread
    lost: float

    @property
    def in_control(self) -> float:
        """Periods in which the controller planned, as a percentage of the periods in which control was requested."""
        requested = self.total("requested")
        return 100.0 * self.total("in_control") / requested if requested else nan

    @property
    def broken(self) -> list[str]:
        """Descriptions of violated invariants and of runs that did not finish."""
        texts = []
        for number, phase in enumerate(self.phases):
            runs = {"did not finish": phase.under, "did not finish without control": phase.free}
            texts += [f"phase {number}: {what}: {one.failure}" for what, one in runs.items() if not one.figures]
            if phase.under.service is not None:
                texts += [f"phase {number}: {text}" for text in phase.under.service.broken]
        return texts

    @property
    def reasons(self) -> dict[str, int]:
        """Numbers of periods with a request in which the controller did not plan, by Reason, in decreasing order."""
        count: Counter[str] = Counter()
        for service in self._services:
            count.update(service.reasons)
        return dict(sorted(count.items(), key=lambda item: (-item[1], item[0])))

    def figures(self) -> dict[str, Any]:
        """Return the row as data for other programs; an unknown value is null."""
        spreads = {
            "reduction_percent": self.reduction,
            **{name: self.spread(name) for name in ("abs_Cl", "mean_Cl", "Cd", "rms_action")},
            **{f"{name}_uncontrolled": self.spread(name, free=True) for name in ("Cd", "abs_Cl")},
        }
        return {
            "name": self.scenario.name,
            "group": self.scenario.group,
            "sentence": self.scenario.sentence,
            "safe": self.safe,
            "use": self.use.value,
            **{
                f"{name}{ending}": rounded(getattr(spread, field))
                for name, spread in spreads.items()
                for field, ending in (("mean", ""), ("least", "_min"), ("most", "_max"))
            },
            "lost_percent": rounded(self.lost),
            "phases": len(self.phases),
            "in_control_percent": rounded(self.in_control),
            "latches": self.total("latches"),
            "not_in_control_reasons": self.reasons,
            **{name: self.total(name) for name in ("frames_sent", "frames_lost", "frames_rejected", "violations")},
            "broken": self.broken,
        }

    def spread(self, name: str, *, free: bool = False) -> Spread:
        """Return the spread of a field of `MeanFigures` over the runs under control or, if `free`, without control."""
        found = [(phase.free if free else phase.under).figures for phase in self.phases]
        return Spread.of([nan if one is None else float(getattr(one, name)) for one in found])

    def total(self, name: str) -> int:
        """Return the sum of one field of `RunService` over the starting phases."""
        return sum(int(getattr(service, name)) for service in self._services)

    @property
    def _services(self) -> list[RunService]:
        return [phase.under.service for phase in self.phases if phase.under.service is not None]


def judged(scenarios: Sequence[Scenario], phases: Mapping[str, Sequence[PhaseOutcomes]]) -> tuple[ScenarioRow, ...]:
    """Return the rows in the plan's order. `phases` has the outcomes of each scenario, by the scenario's name."""
    undisturbed = Spread.of([phase.reduction for phase in phases[UNDISTURBED]]).mean
    rows = []
    for scenario in scenarios:
        found = tuple(phases[scenario.name])
        reduction = Spread.of([phase.reduction for phase in found])
        lost = undisturbed - reduction.mean
        row = ScenarioRow(scenario=scenario, phases=found, safe=False, use=Use.NONE, reduction=reduction, lost=lost)
        free, criteria = row.spread("abs_Cl", free=True).mean, scenario.criteria
        side_force = row.spread("abs_Cl").mean / free if free > 0 else inf
        share = reduction.mean / undisturbed if undisturbed > 0 else nan
        use = Use.MARGINAL if share > criteria.marginal else Use.NONE
        # A comparison with NaN is false, so an unknown outcome is not useful.
        if share >= criteria.useful and side_force <= criteria.abs_Cl:
            use = Use.USEFUL
        rows.append(replace(row, safe=bool(found) and not row.broken, use=use))
    return tuple(rows)


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
    look = " Only one starting phase: others may differ." if rows and all(len(row.phases) == 1 for row in rows) else ""
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
