"""A test plan as data: a scenario is a sentence, what disturbs the loop, and when the outcome counts as useful."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from math import isfinite
from typing import Final

from contract.errors import ConfigError

UNDISTURBED: Final = "undisturbed"
"""Name of the scenario that all others are held against; every plan has it."""
UNCONTROLLED: Final = "uncontrolled"
"""Names a run without control: of the undisturbed flow, or behind the name of a scenario that changes it."""
_NAME: Final = re.compile(r"[a-z0-9][a-z0-9_.]*")
LONGEST_NAME: Final = 80
"""Characters; a name is also part of a file's."""


@dataclass(frozen=True, kw_only=True)
class Criteria:
    """When a scenario's outcome is useful. Safety is not among it: no invariant may break in any scenario. Raises
    ConfigError for a share that is no number, or out of order.

    Attributes:
        useful: least share of the undisturbed drag reduction.
        marginal: above this share it is marginal, otherwise none.
        abs_Cl: largest mean |Cl|, as a share of that without control, for "useful": less drag at the cost of a larger
            side force is no use.
    """

    useful: float = 0.75
    marginal: float = 0.0
    abs_Cl: float = 1.0

    def __post_init__(self) -> None:
        for name in ("useful", "marginal", "abs_Cl"):
            if not isfinite(value := getattr(self, name)):
                raise ConfigError(f"{name} = {value}: must be a finite number")
        if not self.marginal <= self.useful:
            raise ConfigError(f"useful = {self.useful:g}: must be at least marginal, {self.marginal:g}")
        if self.abs_Cl <= 0:
            raise ConfigError(f"abs_Cl = {self.abs_Cl:g}: must be positive")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One line of a test plan. Raises ConfigError for a name that is none, or a scenario without a sentence.

    Attributes:
        name: lower-case letters, digits, dots and underscores; unique in a plan.
        group: title of the part of the plan it belongs to.
        disturb: texts of the disturbances (`firmware_sim.bench.disturbances`), times in s of the run.
        settings: `section.key=value` on top of the campaign's settings.
    """

    name: str
    group: str
    sentence: str
    disturb: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    criteria: Criteria = field(default_factory=Criteria)

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or len(self.name) > LONGEST_NAME:
            raise ConfigError(
                f"name {self.name[:LONGEST_NAME]!r}: must be lower-case letters, digits, dots and underscores, at most "
                f"{LONGEST_NAME}"
            )
        if self.name.rpartition(".")[2] == UNCONTROLLED:
            raise ConfigError(f"name {self.name!r}: a campaign keeps its runs without control under such names")
        if not self.sentence.strip() or not self.sentence.isprintable():
            raise ConfigError(f"sentence {self.sentence!r}: must be one line on what is done to the loop")


@dataclass(frozen=True, kw_only=True)
class Place:
    """What the texts of a plan are filled in with: the release's sensors, and when control begins.

    Attributes:
        sensors: of the release, in its order.
        base_sensor: the first of them on the base; None if none is there.
        enabled_s: when control is requested, s of the run.
        t_c_s: one convective time, s.
    """

    sensors: tuple[str, ...]
    base_sensor: str | None
    enabled_s: float
    t_c_s: float

    def seconds(self, span: float) -> float:
        """A span of t_c in s."""
        return span * self.t_c_s

    def after(self, span: float) -> float:
        """The instant that lies so many t_c after the request for control, in s of the run."""
        return self.enabled_s + self.seconds(span)


def check_names(scenarios: Sequence[Scenario]) -> None:
    """Raises ConfigError if two scenarios have one name, or none is the undisturbed one."""
    seen: dict[str, Scenario] = {}
    for one in scenarios:
        if (other := seen.setdefault(one.name, one)) is not one:
            raise ConfigError(f"scenario {one.name!r} is there twice, in {other.group!r} and in {one.group!r}")
    if UNDISTURBED not in seen:
        raise ConfigError(f"no scenario {UNDISTURBED!r}: all others are held against it")


def selected(scenarios: Sequence[Scenario], globs: Sequence[str]) -> tuple[Scenario, ...]:
    """Those whose name matches a pattern, in the plan's order, and the undisturbed one; all without a pattern. Raises
    ConfigError if a pattern matches none."""
    for glob in globs:
        if not any(fnmatchcase(one.name, glob) for one in scenarios):
            raise ConfigError(f"--only {glob!r}: no scenario has such a name; --list shows them")
    return tuple(one for one in scenarios if one.name == UNDISTURBED or matches(one.name, globs))


def matches(name: str, globs: Sequence[str]) -> bool:
    """Whether a name is among those asked for."""
    return not globs or any(fnmatchcase(name, glob) for glob in globs)
