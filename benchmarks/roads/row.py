"""A row of the table of roads: what a controller reached from each phase, and what it cost to get there.

Averages are a run's: whole shedding cycles before control, and under control as many of the same cycles as fit between
the settling time and the end (`wake.truck.averages`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

import numpy as np

from contract.arrays import Array
from contract.ledger import ledger_of
from firmware_sim.runs.control import trouble
from firmware_sim.runs.run_log import RunLog
from wake.plant.sample import Sample
from wake.truck.averages import over_cycles, over_last_cycles

Kind = Literal["bound", "baseline", "learned", "linear", "oracle"]
"""What the controller was made from: nothing (a flow that no controller made), a formula with tuned constants, a
learned model or policy, a linear model, the flow itself."""
Loop = Literal["CAN", "plant"]
"""Through bus and ECU, or a command straight to the plant, one period late as there."""

_ROUNDING = 1e-9
"""t_c: what the sum of two spans may differ by from the sample's instant."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Averages of one run; coefficients and powers as in `contract.ledger.DragLedger`.

    Attributes:
        Cd_uncontrolled, Cd_net_uncontrolled: of the same wake before control, or of the uncontrolled one elsewhere.
        Cd, Cd_net, abs_Cl, mean_Cl, rms_action, jet_power: under control.
        trouble: what was wrong with the run, as a sentence; None if control was held.
    """

    Cd_uncontrolled: float
    Cd_net_uncontrolled: float
    Cd: float
    Cd_net: float
    abs_Cl: float
    mean_Cl: float
    rms_action: float
    jet_power: float
    trouble: str | None = None

    @property
    def reduction_percent(self) -> float:
        """The reduction of the wall's mean drag."""
        return 100.0 * (1.0 - self.Cd / self.Cd_uncontrolled)

    @property
    def net_reduction_percent(self) -> float:
        """The reduction of `Cd_net`: wall, slots and the jets' momentum together. The jets' power is not in it."""
        return 100.0 * (1.0 - self.Cd_net / self.Cd_net_uncontrolled)


def outcome_of_series(series: Mapping[str, Array], enabled_at: int, settle: float) -> Outcome:
    """The outcome of a run's series by the names of a sample's members, (n,) each.

    Args:
        enabled_at: index of the sample at which control was requested.
        settle: t_c after it that do not count.

    Raises:
        PlantError: if a part holds no whole cycle.
    """
    t = series["t"]
    before, under = slice(0, enabled_at + 1), slice(int(np.searchsorted(t, t[enabled_at] + settle - _ROUNDING)), None)
    free = over_cycles(t[before], series["Cl"][before])
    controlled = over_last_cycles(t[under], free.frequency)
    net = ledger_of(series).Cd_net
    return Outcome(
        Cd_uncontrolled=float(free.mean(series["Cd"][before])),
        Cd_net_uncontrolled=float(free.mean(net[before])),
        Cd=float(controlled.mean(series["Cd"][under])),
        Cd_net=float(controlled.mean(net[under])),
        abs_Cl=float(controlled.mean(np.abs(series["Cl"][under]))),
        mean_Cl=float(controlled.mean(series["Cl"][under])),
        rms_action=float(np.sqrt(controlled.mean(series["action"][under] ** 2))),
        jet_power=float(controlled.mean(series["jet_power"][under])),
    )


def outcome_of_log(log: RunLog) -> Outcome:
    """The outcome of a run through bus and ECU; raises PlantError if a part of it holds no whole cycle."""
    found = outcome_of_series(log.series, log.enabled_at, log.metadata.settle)
    return Outcome(**{**asdict(found), "trouble": trouble(log)})


def outcome_of_samples(samples: Sequence[Sample], enabled_at: int, settle: float) -> Outcome:
    """The outcome of a run on the plant, a sample a control period; as `outcome_of_series`."""
    names = [item.name for item in fields(Sample) if item.name != "Cp"]
    series = {name: np.array([getattr(sample, name) for sample in samples]) for name in names}
    return outcome_of_series(series, enabled_at, settle)


@dataclass(frozen=True, kw_only=True)
class Row:
    """What the table has of a road.

    Attributes:
        road: its name on the command line.
        title: its name for people.
        kind: what the controller was made from.
        outcomes: from each phase of the shedding cycle, one at least.
        sensors: how many it reads.
        loop: how it was connected.
        mesh: cells of the wake that the outcomes are of, (nx, ny).
        start: "developed", or another flow that the runs began in.
        interactions: control periods with the plant, recorded or tried, until it was as it is.
        training_minutes: of one core, without the plant's own time; None where nothing was trained.
        step_ms: median CPU time of a control step here; None where nothing computes.
        m7_ms: modelled on a Cortex-M7 at 480 MHz; None where it cannot run there.
        seeds: of everything drawn.
        note: a sentence for the table.
    """

    road: str
    title: str
    kind: Kind
    outcomes: tuple[Outcome, ...]
    sensors: int
    loop: Loop
    mesh: tuple[int, int]
    start: str = "developed"
    interactions: int = 0
    training_minutes: float | None = None
    step_ms: float | None = None
    m7_ms: float | None = None
    seeds: tuple[int, ...] = ()
    note: str = ""

    def mean(self, name: str) -> float:
        """Over the phases, of an attribute of `Outcome`."""
        return float(np.mean([getattr(outcome, name) for outcome in self.outcomes]))

    def span(self, name: str) -> tuple[float, float]:
        """Its least and its largest value over the phases."""
        found = [float(getattr(outcome, name)) for outcome in self.outcomes]
        return min(found), max(found)

    def as_tree(self) -> dict[str, Any]:
        """For JSON, with what the table shows worked out."""
        least, most = self.span("reduction_percent")
        shown = {
            "reduction_percent": self.mean("reduction_percent"),
            "least_reduction_percent": least,
            "most_reduction_percent": most,
            "net_reduction_percent": self.mean("net_reduction_percent"),
            **{name: self.mean(name) for name in ("Cd", "Cd_net", "abs_Cl", "mean_Cl", "rms_action", "jet_power")},
            "phases": len(self.outcomes),
        }
        return {**asdict(self), **shown}
