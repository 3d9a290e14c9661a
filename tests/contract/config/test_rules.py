"""A rule refuses what lies past its bound, in the words of its definition."""

import math
from dataclasses import dataclass
from typing import Annotated, Any

import pytest

from contract.config.rules import AtLeastOneOrNone, Fraction, NonNegative, Positive, Settings, at_least, within
from contract.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class Sample(Settings):
    positive: Positive[float] = 1.0
    non_negative: NonNegative[int] = 0
    fraction: Fraction[float] = 0.0
    none: AtLeastOneOrNone = None
    pair: Annotated[int, at_least(2, "for a pair")] = 2
    between: Annotated[int, within(1, 127, "half a byte")] = 1


def test_a_rule_holds_up_to_its_bound_and_no_further():
    bounds: list[tuple[str, Any, Any, str]] = [
        ("positive", 1e-300, 0.0, "positive"),
        ("non_negative", 0, -1, "non-negative"),
        ("fraction", math.nextafter(1.0, 0.0), 1.0, r"in \[0, 1\)"),
        ("none", 1, 0, "at least 1"),
        ("none", None, -1, "at least 1"),
        ("pair", 2, 1, "at least 2, for a pair"),
        ("between", 127, 128, r"in 1\.\.127, half a byte"),
    ]
    for field, good, bad, wording in bounds:
        assert getattr(Sample(**{field: good}), field) == good
        with pytest.raises(ConfigError, match=rf"^sample\.{field} = {bad}: must be {wording}$"):
            Sample(**{field: bad})
    with pytest.raises(TypeError):
        Sample(positive=None)  # type: ignore[arg-type]  # None is a value only where the type allows it
