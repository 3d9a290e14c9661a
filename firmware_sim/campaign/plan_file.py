"""Test plans from TOML files; the built-in plans and a user's plans have the same form.

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
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Final

from contract.errors import ConfigError
from contract.typed import read_toml, typed
from firmware_sim.campaign.scenario import LONGEST_NAME, Criteria, Place, Scenario, check_names

BUILT_IN: Final = ("paper", "sensors", "bus", "flow")
"""Names of the files in `plans/`, in the plan's order."""
MOST_SCENARIOS: Final = 1000
_SENSORS: Final = "sensors"
"""Value of `each` with which a scenario is repeated for each sensor of the release."""


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
    """Return the built-in scenarios, then the users' scenarios. Raises ConfigError with the file for a wrong entry."""
    folder = files("firmware_sim.campaign").joinpath("plans")
    sources: list[Traversable] = [*(folder.joinpath(f"{name}.toml") for name in BUILT_IN), *users]
    scenarios = tuple(one for source in sources for one in read_plan(source, place))
    if len(scenarios) > MOST_SCENARIOS:
        raise ConfigError(f"{len(scenarios)} scenarios: must be at most {MOST_SCENARIOS}")
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
            words: dict[str, object] = {"each": value, "after": _Time(place.after), "seconds": _Time(place.seconds)}
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


class _Time:
    """A value for `str.format`. Its format specification is a time in t_c; the result is this time in s."""

    def __init__(self, seconds: Callable[[float], float]) -> None:
        self._seconds = seconds

    def __format__(self, spec: str) -> str:
        return f"{self._seconds(float(spec)):.9g}"


def _filled(text: str, words: Mapping[str, object]) -> str:
    try:
        return text.format_map(words)
    except KeyError as error:
        raise ConfigError(f"{text!r}: {{{error.args[0]}}} must be one of {', '.join(sorted(words))}") from error
    except (ValueError, IndexError, AttributeError, TypeError) as error:
        raise ConfigError(f"{text!r}: cannot be filled in ({error})") from error
