"""The metadata of a setting's type: the allowed values, the unit, and the source of the default.

    horizon: Annotated[int, at_least(2), STEPS, paper("section 2.4")] = 25

`Settings` checks the rules of its fields when an instance is created. To check a condition on two fields, a class
defines `_check_together`, which calls `require`. A number without a unit is a ratio, or a count whose name states what
is counted. Units are only displayed; no value is converted. A field without a source has the source of its section.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Annotated, Any, ClassVar, Final, Literal, TypeVar, get_args, get_type_hints

from contract.errors import ConfigError
from contract.printable import quoted


@dataclass(frozen=True)
class Source:
    """The source of a default value: metadata of an `Annotated` type, or of a class of settings.

    Attributes:
        place: place in the paper, or name of the standard; "" if the default is the project's own.
        note: how the default follows from the source, or the reason for a default of the project.
        page: page of `docs/` with more about the default; "" if there is none.
    """

    kind: Literal["paper", "standard", "ours"]
    place: str = ""
    note: str = ""
    page: str = ""

    @property
    def name(self) -> str:
        """The source and the place in it, as one text: "paper, section 2.1", "SAE J2284-4", "ours"."""
        return self.place if self.kind == "standard" else ", ".join(filter(None, (self.kind, self.place)))


def paper(place: str, note: str = "") -> Source:
    """Mark a default as the number at a place in the paper, such as "section 2.1". If the number is not stated there,
    `note` says how it follows. Equations have the manuscript's numbers, which do not restart with each section."""
    return Source("paper", place=place, note=note)


def standard(name: str, note: str) -> Source:
    """Mark a default as a number from a published standard."""
    return Source("standard", place=name, note=note)


def ours(reason: str, *, page: str = "") -> Source:
    """Mark a default as the project's own number. `reason` justifies the number, and `page` says more about it."""
    return Source("ours", note=reason, page=page)


@dataclass(frozen=True)
class Unit:
    """A unit, as it is written after a number. It is metadata of an `Annotated` type."""

    name: str


WIDTHS: Final = Unit("W")
"""Unit of lengths: the width W of the body."""
TIME: Final = Unit("t_c")
"""Unit of times: the convective time, t_c = W / U_inf."""
FREQUENCY: Final = Unit("1/t_c")
FLOW_RATE: Final = Unit("U_inf W")
"""Unit of actions: flow rate of the jets per unit span."""
STEPS: Final = Unit("control steps")
PERIODS: Final = Unit("periods")
"""Unit of durations on the vehicle's clock: the control period."""
FRAMES: Final = Unit("frames")
BIT_RATE: Final = Unit("bit/s")
MILLISECONDS: Final = Unit("ms")
PASSES: Final = Unit("passes")
"""Unit of training lengths: passes over the recording."""
WINDOWS: Final = Unit("windows")
"""Unit of counts of windows; a window is a number of consecutive rows of a recording."""


T = TypeVar("T", int, float)

TINY: Final = 1e-45
HUGE: Final = 1e12
"""Largest magnitude of a nonzero real setting; `TINY` is the smallest. The bounds also apply to calibrated weights
(float32)."""
MOST: Final = 2**31 - 1
"""Largest magnitude of an integer setting, so that a number of periods in ns does not overflow 64 bits."""


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A condition on a text or a number. A number must also be finite.

    Attributes:
        wording: text of the condition that completes the sentence "the value must be ...".
        or_none: whether None is also allowed.
    """

    wording: str
    holds: Callable[[Any], bool]
    or_none: bool = False

    def admits(self, value: float | str | None) -> bool:
        """Return whether a field with this rule may have the value."""
        if value is None and self.or_none:
            return True
        if isinstance(value, str | int):
            return self.holds(value)
        return isfinite(value) and self.holds(value)  # type: ignore[arg-type]  # None elsewhere is a TypeError


def at_least(least: int, reason: str = "", *, or_none: bool = False) -> Rule:
    """Return the rule that a value must be at least `least`. The rule's wording contains the reason."""
    wording = f"at least {least}{f', {reason}' if reason else ''}"
    return Rule(wording=wording, holds=lambda value: value >= least, or_none=or_none)


def within(least: float, most: float, reason: str) -> Rule:
    """Return the rule that a value must be from `least` to `most`. The rule's wording contains the reason."""
    return Rule(wording=f"in {least}..{most}: {reason}", holds=lambda value: least <= value <= most)


Finite = Annotated[T, Rule(wording="finite", holds=isfinite)]
Positive = Annotated[T, Rule(wording="positive", holds=lambda value: value > 0)]
NonNegative = Annotated[T, Rule(wording="non-negative", holds=lambda value: value >= 0)]
Fraction = Annotated[T, Rule(wording="in [0, 1)", holds=lambda value: 0 <= value < 1)]
AtLeastOne = Annotated[T, at_least(1)]
AtLeastOneOrNone = Annotated[int | None, at_least(1, or_none=True)]


class Settings:
    """The base class of the settings' dataclasses. It validates every instance when the instance is created.

    Raises ConfigError for a value that breaks the rule of its field; the message states section, field, value and rule.

    Attributes:
        section: dotted name of the section in the tree; by default, the class name without "Config".
        source: source of a default whose field states no source; None if every field states a source.
    """

    section: ClassVar[str]
    source: ClassVar[Source | None]
    _rules: ClassVar[Mapping[str, Rule]] = {}

    def __init_subclass__(cls, section: str | None = None, source: Source | None = None) -> None:
        cls.section = cls.__name__.removesuffix("Config").lower() if section is None else section
        cls.source = source
        hints: Mapping[str, Any] = get_type_hints(cls, include_extras=True)
        cls._rules = {name: rule for name, hint in hints.items() for rule in get_args(hint) if isinstance(rule, Rule)}

    def __post_init__(self) -> None:
        for name, rule in self._rules.items():
            value = getattr(self, name)
            if isinstance(value, float) and isfinite(value) and value:
                # Outside these bounds, the product of a few settings may overflow or underflow.
                require(TINY <= abs(value) <= HUGE, self, name, f"0, or from {TINY:g} to {HUGE:g} in size")
            require(rule.admits(value), self, name, rule.wording)
            if isinstance(value, int):
                require(abs(value) <= MOST, self, name, f"at most {MOST} in size")
        self._check_together()

    def _check_together(self) -> None:
        """Check the conditions on several fields of a subclass."""


def require(holds: bool, owner: Settings, name: str, wording: str) -> None:
    """Raise ConfigError if the condition does not hold. The message states the named field's value."""
    if not holds:
        raise ConfigError(f"{owner.section}.{name} = {quoted(getattr(owner, name))}: must be {wording}")
