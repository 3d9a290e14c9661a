"""The rules for the values of settings. A rule is metadata of a setting's type, like its notes
(`contract.config.notes`):

    horizon: Annotated[int, at_least(2), STEPS, paper("section 2.4")] = 25

`Settings` checks the rules of its fields when an instance is created. To check a condition on two fields, a class
defines `_check_together`, which calls `require`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Annotated, Any, ClassVar, Final, TypeVar, get_args, get_type_hints

from contract.config.notes import Source
from contract.errors import ConfigError
from contract.printable import quoted

T = TypeVar("T", int, float)
TINY: Final = 1e-45
HUGE: Final = 1e12
"""Largest magnitude of a nonzero real setting; `TINY` is the smallest. The bounds also apply to float32 weights."""
MOST: Final = 2**31 - 1
"""Largest magnitude of an integer setting, so that a number of periods in ns does not overflow 64 bits."""


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A condition on a text or a number; a number must also be finite. `wording` completes "the value must be ..."."""

    wording: str
    holds: Callable[[Any], bool]


def at_least(least: int, reason: str = "") -> Rule:
    """Return the rule that a value must be at least `least`. The rule's wording contains the reason."""
    return Rule(wording=f"at least {least}{f', {reason}' if reason else ''}", holds=lambda value: value >= least)


def within(least: float, most: float, reason: str) -> Rule:
    """Return the rule that a value must be from `least` to `most`. The rule's wording contains the reason."""
    return Rule(wording=f"in {least}..{most}: {reason}", holds=lambda value: least <= value <= most)


Finite = Annotated[T, Rule(wording="finite", holds=isfinite)]
Positive = Annotated[T, Rule(wording="positive", holds=lambda value: value > 0)]
NonNegative = Annotated[T, Rule(wording="non-negative", holds=lambda value: value >= 0)]
Fraction = Annotated[T, Rule(wording="in [0, 1)", holds=lambda value: 0 <= value < 1)]
AtLeastOne = Annotated[T, at_least(1)]


class Settings:
    """The base class of the settings' dataclasses. `section` is the dotted name in the tree; by default, the class name
    without "Config". `source` is the source of defaults whose fields state no source. A new instance raises ConfigError
    for a value that breaks the rule of its field; the message states section, field, value and rule."""

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
            is_finite = isinstance(value, str | int | None) or isfinite(value)
            if isinstance(value, float) and is_finite and value:
                # Outside these bounds, the product of a few settings may overflow or underflow.
                require(TINY <= abs(value) <= HUGE, self, name, f"0, or from {TINY:g} to {HUGE:g} in size")
            require(is_finite and rule.holds(value), self, name, rule.wording)
            if isinstance(value, int):
                require(abs(value) <= MOST, self, name, f"at most {MOST} in size")
        self._check_together()

    def _check_together(self) -> None:
        """Check the conditions on several fields of a subclass."""


def require(holds: bool, owner: Settings, name: str, wording: str) -> None:
    """Raise ConfigError if the condition does not hold. The message states the named field's value."""
    if not holds:
        raise ConfigError(f"{owner.section}.{name} = {quoted(getattr(owner, name))}: must be {wording}")
