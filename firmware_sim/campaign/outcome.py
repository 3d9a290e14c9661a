"""What one run of a campaign leaves behind: its figures, the invariants it broke, and a short record of its course."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.atomic import replacing
from contract.errors import ConfigError
from contract.typed import typed

_SCHEMA: Final = "stillwake-campaign-run/1"
COURSE: Final = ("t", "Cd", "Cl", "action")
"""The series that are kept, a value a control period."""
DECIMALS: Final = 6
"""Digits of kept series: a tenth of what the wire resolves of an action."""
MOST_KEPT: Final = 20
"""Violations that are kept word for word; all of them are counted."""


@dataclass(frozen=True, kw_only=True)
class KeptCourse:
    """The series of a run, by the names in `COURSE`, and when control was requested."""

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
    """Means over the periods that are averaged, every one with the same weight; coefficients as in `Sample`."""

    Cd: float
    abs_Cl: float
    mean_Cl: float
    rms_action: float

    @classmethod
    def over(cls, course: KeptCourse, from_t: float) -> "MeanFigures":
        """Average from an instant, in the course's time, to the end.

        The same instants are averaged with control and without, beginning in the same phase of shedding, so that what
        is cut of a cycle is the same in both.
        """
        t = np.array(course.t)
        kept = t >= from_t - 1e-9  # what sums of spans may differ by from the sample's instant
        cd, cl, action = (np.array(getattr(course, name))[kept] for name in ("Cd", "Cl", "action"))
        return cls(
            Cd=float(cd.mean()),
            abs_Cl=float(np.abs(cl).mean()),
            mean_Cl=float(cl.mean()),
            rms_action=float(np.sqrt((action**2).mean())),
        )


@dataclass(frozen=True, kw_only=True)
class RunService:
    """What the ECU and the bus did in a run under control.

    Attributes:
        requested: control periods in which control was requested, those apart in which the window was still filling.
        in_control: of these, periods in which the controller planned.
        latches: how often the ECU latched a fault.
        reasons: control periods in which it was not in control, by the reason it gave.
        frames_sent, frames_lost, frames_rejected: pressure frames and commands.
        violations: how often an invariant broke.
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
    """One run.

    Attributes:
        key: hash of everything that decides the run.
        figures, course: None for a run that did not finish.
        service: None for a run without control, or one that did not finish.
        failure: why it did not finish, in words; "" if it did.
    """

    key: str
    figures: MeanFigures | None = None
    course: KeptCourse | None = None
    service: RunService | None = None
    failure: str = ""


def save(path: Path, outcome: RunOutcome) -> None:
    """Write as JSON, whole or not at all, the same bytes for the same outcome."""
    content = {"schema": _SCHEMA, **asdict(outcome)}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, sort_keys=True) + "\n", encoding="utf-8")


def load(path: Path) -> RunOutcome | None:
    """What `save` wrote; None for a file that is missing, damaged or of another version: it is made again."""
    try:
        tree: Any = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(tree, dict) or tree.pop("schema", None) != _SCHEMA:
            return None
        return typed(tree, RunOutcome)
    except (OSError, ValueError, RecursionError, ConfigError):
        return None
