"""A test plan as data: each scenario has a description, disturbances of the loop, and criteria for a useful outcome."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from math import isfinite
from typing import Final

from contract.errors import ConfigError

UNDISTURBED: Final = "undisturbed"
"""Name of the scenario with which all others are compared; every plan contains this scenario."""
UNCONTROLLED: Final = "uncontrolled"
"""Name of the runs without control in the undisturbed flow; in a scenario's flow, the scenario's name comes first."""
_NAME: Final = re.compile(r"[a-z0-9][a-z0-9_.]*")
LONGEST_NAME: Final = 80
"""Largest number of characters of a name, which is also part of a file name."""


@dataclass(frozen=True, kw_only=True)
class Criteria:
    """Criteria for a useful outcome. `useful` and `marginal` are the smallest drag reductions, as shares of the drag
    reduction in the undisturbed scenario. `abs_Cl` is the largest mean |Cl| if useful, as a share of its value
    without control. Raises ConfigError for values that are not finite or contradict each other."""

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
    """One scenario of a test plan. Raises ConfigError if the name is invalid or there is no sentence.

    Attributes:
        name: lower-case letters, digits, dots and underscores; unique in a plan.
        group: title of the scenario's group in the plan.
        disturb: texts of the disturbances (`firmware_sim.bench.disturbances`); times in s from the start of the run.
        settings: `section.key=value` texts that override the campaign's settings.
    """

    name: str
    group: str
    sentence: str
    disturb: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    criteria: Criteria = field(default_factory=Criteria)

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or len(self.name) > LONGEST_NAME:
            rule = f"lower-case letters, digits, dots and underscores, at most {LONGEST_NAME}"
            raise ConfigError(f"name {self.name[:LONGEST_NAME]!r}: must be {rule}")
        if self.name.rpartition(".")[2] == UNCONTROLLED:
            raise ConfigError(f"name {self.name!r}: a campaign stores its runs without control under such names")
        if not self.sentence.strip() or not self.sentence.isprintable():
            raise ConfigError(f"sentence {self.sentence!r}: must be one line that states the disturbance of the loop")


@dataclass(frozen=True, kw_only=True)
class Place:
    """Values that the texts of a plan may use: the release's sensors, its first sensor on the base, the time from the
    start of the run to the request for control, and the convective time. Times are in s."""

    sensors: tuple[str, ...]
    base_sensor: str | None
    enabled_s: float
    t_c_s: float

    def seconds(self, span: float) -> float:
        """Convert a span from t_c to s."""
        return span * self.t_c_s

    def after(self, span: float) -> float:
        """Return the instant that is `span` t_c after the request for control, in s from the start of the run."""
        return self.enabled_s + self.seconds(span)


def check_names(scenarios: Sequence[Scenario]) -> None:
    """Raise ConfigError if two scenarios have the same name, or the undisturbed scenario is missing."""
    seen: dict[str, Scenario] = {}
    for one in scenarios:
        if (other := seen.setdefault(one.name, one)) is not one:
            raise ConfigError(f"scenario {one.name!r} occurs twice, in {other.group!r} and in {one.group!r}")
    if UNDISTURBED not in seen:
        raise ConfigError(f"no scenario {UNDISTURBED!r}: all others are compared with it")


def selected(scenarios: Sequence[Scenario], globs: Sequence[str]) -> tuple[Scenario, ...]:
    """Return the scenarios whose name matches a pattern, and always the undisturbed scenario, in the plan's order;
    without patterns, return all scenarios. Raises ConfigError if a pattern matches no scenario."""
    found = {UNDISTURBED}
    for glob in globs or ["*"]:
        names = {one.name for one in scenarios if fnmatchcase(one.name, glob)}
        if not names:
            raise ConfigError(f"--only {glob!r}: no scenario has a matching name; --list shows the names")
        found |= names
    return tuple(one for one in scenarios if one.name in found)
