"""The outcome of one run of a campaign: its figures, its violated invariants, and short series."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from contract.arrays import Array

COURSE: Final = ("t", "Cd", "Cl", "action")
"""Names of the stored series, which have one value per control period."""
DECIMALS: Final = 6
"""Number of decimals of the stored series. The last decimal is a tenth of the resolution of actions on the bus."""
MOST_KEPT: Final = 20
"""Largest number of violations that are stored as text; all violations are counted."""


@dataclass(frozen=True, kw_only=True)
class KeptCourse:
    """The stored series of a run, with the names in `COURSE`, and the time of the request for control."""

    t: list[float]
    Cd: list[float]
    Cl: list[float]
    action: list[float]
    enabled_t: float

    @classmethod
    def of(cls, series: Mapping[str, Array], enabled_t: float) -> "KeptCourse":
        kept = {name: [round(float(value), DECIMALS) for value in series[name]] for name in COURSE}
        return cls(**kept, enabled_t=round(enabled_t, DECIMALS))


@dataclass(frozen=True, kw_only=True)
class MeanFigures:
    """Means over the averaged periods; `Sample` defines the coefficients."""

    Cd: float
    abs_Cl: float
    mean_Cl: float
    rms_action: float

    @classmethod
    def over(cls, course: KeptCourse, from_t: float) -> "MeanFigures":
        """Average over the samples from `from_t` on. With and without control this is the same part of a cycle."""
        kept = np.array(course.t) >= from_t - 1e-9  # allows for rounding in sums of spans
        cd, cl, action = (np.array(getattr(course, name))[kept] for name in ("Cd", "Cl", "action"))
        return cls(
            Cd=float(cd.mean()),
            abs_Cl=float(np.abs(cl).mean()),
            mean_Cl=float(cl.mean()),
            rms_action=float(np.sqrt((action**2).mean())),
        )


@dataclass(frozen=True, kw_only=True)
class RunService:
    """Counts of the ECU and the bus in a run under control.

    Attributes:
        requested: number of periods with a request for control after the controller's window was filled.
        in_control: number of the requested periods in which the controller planned.
        latches: number of times that the ECU latched a fault.
        reasons: number of control periods without control, for each reason that the ECU gave.
        frames_sent, frames_lost, frames_rejected: counts of pressure frames and commands.
    """

    requested: int
    in_control: int
    latches: int
    reasons: dict[str, int] = field(default_factory=dict)
    frames_sent: int
    frames_lost: int
    frames_rejected: int
    violations: int = 0
    broken: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class RunOutcome:
    """The outcome of one run. `key` is the hash of everything that the run depends on. If the run did not finish,
    `failure` is the reason, and the other fields are None. A run without control has no `service` (None)."""

    key: str
    figures: MeanFigures | None = None
    course: KeptCourse | None = None
    service: RunService | None = None
    failure: str = ""
