"""The judgement of a campaign, one row per scenario: safety, benefit of control, spread over the starting phases."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import inf, isfinite, nan
from typing import Any

from firmware_sim.campaign.outcome import RunOutcome, RunService
from firmware_sim.campaign.scenario import UNDISTURBED, Criteria, Scenario
from firmware_sim.runs.statistics import rounded


class Use(StrEnum):
    """Classes of the controller's benefit under a disturbance."""

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
    """Mean, minimum and maximum over the starting phases."""

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
    """The outcome of one scenario.

    Attributes:
        safe: whether the runs from all starting phases finished without a violated invariant.
        reduction: reduction of wall drag in percent, relative to the run from the same starting phase without control.
        lost: mean reduction in the undisturbed scenario minus mean reduction in this one, in percentage points.
    """

    scenario: Scenario
    phases: tuple[PhaseOutcomes, ...]
    safe: bool
    use: Use
    reduction: Spread
    lost: float

    @property
    def in_control(self) -> float:
        """Percentage of the periods with a request for control in which the controller planned."""
        requested = self.total("requested")
        return 100.0 * self.total("in_control") / requested if requested else nan

    @property
    def broken(self) -> list[str]:
        """Descriptions of violated invariants and of runs that did not finish."""
        texts = []
        for number, phase in enumerate(self.phases):
            if phase.under.service is None:
                texts.append(f"phase {number}: did not finish: {phase.under.failure}")
            else:
                texts += [f"phase {number}: {text}" for text in phase.under.service.broken]
        return texts

    @property
    def reasons(self) -> dict[str, int]:
        """Number of control periods without control for each reason that the ECU gave, the most frequent first."""
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
    """Return the rows in the plan's order. `phases` has the outcomes of each scenario by its name."""
    undisturbed = Spread.of([phase.reduction for phase in phases[UNDISTURBED]]).mean
    rows = []
    for scenario in scenarios:
        found = tuple(phases[scenario.name])
        reduction = Spread.of([phase.reduction for phase in found])
        services, lost = [phase.under.service for phase in found], undisturbed - reduction.mean
        safe = bool(found) and all(service is not None and service.violations == 0 for service in services)
        row = ScenarioRow(scenario=scenario, phases=found, safe=safe, use=Use.NONE, reduction=reduction, lost=lost)
        free = row.spread("abs_Cl", free=True).mean
        side_force = row.spread("abs_Cl").mean / free if free > 0 else inf
        rows.append(replace(row, use=use_of(reduction.mean, undisturbed, side_force, scenario.criteria)))
    return tuple(rows)


def use_of(reduction: float, undisturbed: float, side_force: float, criteria: Criteria) -> Use:
    """Judge an outcome. `reduction` and `undisturbed` are the reductions of wall drag in this and in the undisturbed
    scenario, in percent. `side_force` is mean |Cl| as a share of its value without control."""
    share = reduction / undisturbed if undisturbed > 0 else nan
    # A comparison with NaN is false, so an unknown outcome is not useful.
    if share >= criteria.useful and side_force <= criteria.abs_Cl:
        return Use.USEFUL
    return Use.MARGINAL if share > criteria.marginal else Use.NONE
