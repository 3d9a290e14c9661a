"""Metadata of a setting's type: what it may hold, what it is counted in, where its default comes from.

    horizon: Annotated[int, at_least(2), STEPS, paper("section 2.4")] = 25

`Settings` checks the rules of its fields when it is built; a condition on two fields is a `require` in the class's own
`__post_init__`. A number without a unit is a ratio, or counts what its name states; nothing is converted. A field
without a source of its own has that of its section.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Annotated, Any, ClassVar, Final, Literal, TypeVar, get_args, get_type_hints

from contract.errors import ConfigError
from contract.printable import LARGEST, quoted


@dataclass(frozen=True)
class Source:
    """Metadata of an `Annotated` type, and of a class of settings: where defaults come from.

    Attributes:
        place: in the paper, or the name of the standard; "" where the default is ours.
        note: how the default follows from it; for ours the reason.
        page: of `docs/`, with more about it; "" for none.
    """

    kind: Literal["paper", "standard", "ours"]
    place: str = ""
    note: str = ""
    page: str = ""

    @property
    def name(self) -> str:
        """Who gives the default, and where: "paper, section 2.1", "SAE J2284-4", "ours"."""
        return self.place if self.kind == "standard" else ", ".join(filter(None, (self.kind, self.place)))


def paper(place: str, note: str = "") -> Source:
    """A number that the paper gives at that place, e.g. "section 2.1"; a note where it follows without being written.

    Numbers of equations are those of the manuscript, counted through.
    """
    return Source("paper", place=place, note=note)


def standard(name: str, note: str) -> Source:
    """A number of a published standard."""
    return Source("standard", place=name, note=note)


def ours(reason: str, *, page: str = "") -> Source:
    """A number of this project: why it is this one, and the page with more about it, if there is one."""
    return Source("ours", note=reason, page=page)


@dataclass(frozen=True)
class Unit:
    """Metadata of an `Annotated` type: a unit as it is written behind a number."""

    name: str


WIDTHS: Final = Unit("W")
"""Widths of the body."""
TIME: Final = Unit("t_c")
"""Convective times, W / U_inf."""
FREQUENCY: Final = Unit("1/t_c")
FLOW_RATE: Final = Unit("U_inf W")
"""Flow rate of the jets by unit span: the unit of actions."""
STEPS: Final = Unit("control steps")
PERIODS: Final = Unit("periods")
"""Control periods, on the clock of the vehicle."""
FRAMES: Final = Unit("frames")
BIT_RATE: Final = Unit("bit/s")
MILLISECONDS: Final = Unit("ms")
PASSES: Final = Unit("passes")
"""Over the recording."""
WINDOWS: Final = Unit("windows")
"""Stretches of consecutive rows of a recording."""


T = TypeVar("T", int, float)

TINY: Final = 1e-45
HUGE: Final = 1e12
"""Sizes of a setting that is a real number and not 0: also of a float32 from calibration."""


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A condition on a number, which must also be finite, or on a text.

    Attributes:
        wording: of the condition, after "must be".
        or_none: whether None is also allowed.
    """

    wording: str
    holds: Callable[[Any], bool]
    or_none: bool = False

    def admits(self, value: float | str | None) -> bool:
        """Whether a field may hold this value."""
        if value is None and self.or_none:
            return True
        if isinstance(value, str):
            return self.holds(value)
        if isinstance(value, int):
            return abs(value) < LARGEST and self.holds(value)
        return isfinite(value) and self.holds(value)  # type: ignore[arg-type]  # None elsewhere is a TypeError


def at_least(least: int, reason: str = "", *, or_none: bool = False) -> Rule:
    """A lower bound, with the reason for it where there is one."""
    wording = f"at least {least}{f', {reason}' if reason else ''}"
    return Rule(wording=wording, holds=lambda value: value >= least, or_none=or_none)


def within(least: float, most: float, reason: str) -> Rule:
    """Both bounds, and the reason for them."""
    return Rule(wording=f"in {least}..{most}: {reason}", holds=lambda value: least <= value <= most)


Finite = Annotated[T, Rule(wording="finite", holds=isfinite)]
Positive = Annotated[T, Rule(wording="positive", holds=lambda value: value > 0)]
NonNegative = Annotated[T, Rule(wording="non-negative", holds=lambda value: value >= 0)]
Fraction = Annotated[T, Rule(wording="in [0, 1)", holds=lambda value: 0 <= value < 1)]
AtLeastOne = Annotated[T, at_least(1)]
AtLeastOneOrNone = Annotated[int | None, at_least(1, or_none=True)]


class Settings:
    """Base of the dataclasses of settings: one that exists is valid.

    Raises ConfigError for a value that breaks its field's rule; the message names section, field, value and rule.

    Attributes:
        section: the dotted name of the section in the tree. Without one it is the name of the class without "Config".
        source: where the defaults of fields come from whose types name no source; None if all do.
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
                # Beyond, a product of two settings is soon no number.
                require(TINY <= abs(value) <= HUGE, self, name, f"0, or from {TINY:g} to {HUGE:g} in size")
            require(rule.admits(value), self, name, rule.wording)


def require(holds: bool, owner: Settings, name: str, wording: str) -> None:
    """Raise ConfigError with the value of that field, unless the condition holds."""
    if not holds:
        raise ConfigError(f"{owner.section}.{name} = {quoted(getattr(owner, name))}: must be {wording}")
