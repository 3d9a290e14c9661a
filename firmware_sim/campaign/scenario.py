"""A test plan as data: each scenario has a description, disturbances of the loop, and criteria for a useful outcome.
Plans are TOML files; the built-in plans and a user's plans have the same form.

    [[group]]
    title = "Sensor noise"

    [[group.scenario]]
    name = "noise_{each}"
    each = [0.1, 0.5]
    sentence = "White noise of {each} global deviations on all sensors."
    disturb = ["noise:level={each}@{after:20}.."]
    set = ["ecu.delay_steps=2"]
    criteria = { useful = 0.5 }

A scenario with `each` expands to several scenarios: one for each value or, with `each = "sensors"`, one for each sensor
of the release. The texts of a scenario may use these names: `{each}` is the value; `{base_sensor}` is the release's
first sensor on the base; `{sensor_1}`, `{sensor_2}` and so on are the release's sensors; `{after:20}` is the instant
20 t_c after the request for control, in s from the start of the run; `{seconds:20}` is the length of 20 t_c in s.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from importlib.resources import files
from importlib.resources.abc import Traversable
from math import isfinite
from pathlib import Path
from typing import Any, Final

from contract.errors import ConfigError
from contract.typed import read_toml, typed

UNDISTURBED: Final = "undisturbed"
"""Name of the scenario with which all other scenarios are compared; every plan contains this scenario."""
UNCONTROLLED: Final = "uncontrolled"
"""Name of the runs without control in the undisturbed flow; in a scenario's own flow, they are NAME.uncontrolled."""
_NAME: Final = re.compile(r"[a-z0-9][a-z0-9_.]*")
LONGEST_NAME: Final = 80
"""Largest number of characters of a name, which is also part of a file name."""
BUILT_IN: Final = ("paper", "sensors", "bus", "flow")
"""Names of the files in `plans/`, in the order in which `whole_plan` reads them."""
MOST_SCENARIOS: Final = 1000
_SENSORS: Final = "sensors"  # value of `each` with which a scenario is repeated for each sensor of the release


@dataclass(frozen=True, kw_only=True)
class Criteria:
    """The criteria for an outcome. A useful outcome has at least the drag reduction `useful` and a mean |Cl| of at most
    `abs_Cl` times its value without control. A marginal outcome has a larger drag reduction than `marginal`. Reductions
    are shares of the undisturbed scenario's reduction. Raises ConfigError for wrong or inconsistent values."""

    useful: float = 0.75
    marginal: float = 0.0
    abs_Cl: float = 1.0

    def __post_init__(self) -> None:
        for name in ("useful", "marginal", "abs_Cl"):
            if not isfinite(value := getattr(self, name)):
                raise ConfigError(f"{name} = {value}: must be a finite number")
        if not self.marginal <= self.useful <= 1:
            raise ConfigError(f"useful = {self.useful:g}: must be between marginal ({self.marginal:g}) and 1")
        if self.abs_Cl <= 0:
            raise ConfigError(f"abs_Cl = {self.abs_Cl:g}: must be positive")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A scenario of a test plan, with the title of its group. `disturb` has the texts of disturbances
    (`firmware_sim.bench.disturbances`), with times in s from the start of the run; `settings` has `section.key=value`
    texts that override the campaign's settings. Raises ConfigError if the name or the sentence is invalid."""

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
    """The values that a plan's texts may use: the release's sensors, its first sensor on the base, the time from the
    start of the run to the request for control, and the convective time. Times are in s."""

    sensors: tuple[str, ...]
    base_sensor: str | None
    enabled_s: float
    t_c_s: float


def check_names(scenarios: Sequence[Scenario]) -> None:
    """Raise ConfigError if two scenarios have the same name, or the undisturbed scenario is missing."""
    seen: dict[str, Scenario] = {}
    for one in scenarios:
        if (other := seen.setdefault(one.name, one)) is not one:
            raise ConfigError(f"scenario {one.name!r} occurs twice, in {other.group!r} and in {one.group!r}")
    if UNDISTURBED not in seen:
        raise ConfigError(f"no scenario {UNDISTURBED!r}: all other scenarios are compared with this scenario")


def selected(scenarios: Sequence[Scenario], globs: Sequence[str]) -> tuple[Scenario, ...]:
    """Return the undisturbed scenario and the scenarios whose name matches a pattern, in the plan's order. Without
    patterns, return all scenarios. Raises ConfigError if a pattern matches no scenario."""
    found = {UNDISTURBED}
    for glob in globs or ["*"]:
        names = {one.name for one in scenarios if fnmatchcase(one.name, glob)}
        if not names:
            raise ConfigError(f"--only {glob!r}: no scenario has a matching name; --list shows the names")
        found |= names
    return tuple(one for one in scenarios if one.name in found)


@dataclass(frozen=True, kw_only=True)
class _ScenarioForm:
    name: str
    sentence: str
    disturb: list[str] = field(default_factory=list)
    set: list[str] = field(default_factory=list)
    each: list[int | float | str] | str | None = None
    criteria: Criteria | None = None


@dataclass(frozen=True, kw_only=True)
class _GroupForm:
    """The format of a group. Each scenario is parsed separately, so that an error can state the scenario's name."""

    title: str
    scenario: list[dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class _PlanForm:
    """The format of a whole file; `criteria` applies to all scenarios without their own criteria."""

    group: list[_GroupForm]
    criteria: Criteria = field(default_factory=Criteria)


def whole_plan(users: Sequence[Path], place: Place) -> tuple[Scenario, ...]:
    """Return the built-in scenarios, then the users' scenarios. Raises ConfigError with the file of an error."""
    folder = files("firmware_sim.campaign").joinpath("plans")
    sources: list[Traversable] = [*(folder.joinpath(f"{name}.toml") for name in BUILT_IN), *users]
    scenarios = tuple(one for source in sources for one in read_plan(source, place))
    if len(scenarios) > MOST_SCENARIOS:
        raise ConfigError(f"the plan has {len(scenarios)} scenarios; it must have at most {MOST_SCENARIOS}")
    check_names(scenarios)
    return scenarios


def read_plan(source: Traversable, place: Place) -> tuple[Scenario, ...]:
    """Read the scenarios of one file. Raises ConfigError as `whole_plan` does."""
    tree = read_toml(source, "plan")
    try:
        plan = typed(tree, _PlanForm)
        return tuple(
            made for group in plan.group for raw in group.scenario for made in _made(raw, group, plan.criteria, place)
        )
    except ConfigError as error:
        raise ConfigError(f"plan {source}: {error}") from error


def _made(raw: Mapping[str, Any], group: _GroupForm, criteria: Criteria, place: Place) -> Iterator[Scenario]:
    try:
        form = typed(raw, _ScenarioForm)
        for value in _values(form, place):
            times = {"after": _Time(place.enabled_s, place.t_c_s), "seconds": _Time(0.0, place.t_c_s)}
            words: dict[str, object] = {"each": value, **times}
            words |= {f"sensor_{number}": name for number, name in enumerate(place.sensors, start=1)}
            if place.base_sensor is not None:
                words["base_sensor"] = place.base_sensor
            slug = re.sub(r"[^a-z0-9_.]+", "_", str(value).lower())
            yield Scenario(
                name=_filled(form.name, {**words, "each": slug}),
                group=group.title,
                sentence=_filled(form.sentence, words),
                disturb=tuple(_filled(text, words) for text in form.disturb),
                settings=tuple(_filled(text, words) for text in form.set),
                criteria=form.criteria or criteria,
            )
    except ConfigError as error:
        raise ConfigError(f"scenario {str(raw.get('name', '?'))[:LONGEST_NAME]!r}: {error}") from error


def _values(form: _ScenarioForm, place: Place) -> Sequence[int | float | str]:
    if form.each is None:
        return ("",)
    if form.each == _SENSORS:
        return place.sensors
    if isinstance(form.each, str) or not form.each:
        raise ConfigError(f"each = {form.each!r}: must be a list of values, or {_SENSORS!r}")
    return form.each


@dataclass(frozen=True)
class _Time:
    """A value for `str.format`. Its format specification is a time in t_c; the text is `start_s` + this time in s."""

    start_s: float
    t_c_s: float

    def __format__(self, spec: str) -> str:
        return f"{self.start_s + float(spec) * self.t_c_s:.9g}"


def _filled(text: str, words: Mapping[str, object]) -> str:
    try:
        return text.format_map(words)
    except KeyError as error:
        raise ConfigError(f"{text!r} contains {{{error.args[0]}}}; valid names: {', '.join(sorted(words))}") from error
    except (ValueError, IndexError, AttributeError, TypeError) as error:
        raise ConfigError(f"{text!r} cannot be filled in ({error})") from error
