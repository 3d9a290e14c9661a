"""What is tuned, by the names of the settings, and between which values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Final

from contract.config.controller import MpcConfig
from contract.errors import ConfigError

Values = Mapping[str, float]
"""Settings by name, such as `mpc.weights.lift`."""

WEIGHTS: Final = "mpc.weights."
LEARNING_RATE: Final = "mpc.learning_rate"
HORIZON: Final = "mpc.horizon"
_DIGITS: Final = 3


@dataclass(frozen=True, kw_only=True)
class Range:
    """Values that a setting may take.

    Attributes:
        low, high: ends, included.
        log: whether equal ratios are equally likely, and not equal differences.
        whole: whole numbers only.
    """

    low: float
    high: float
    log: bool = False
    whole: bool = False

    def with_value(self, value: float) -> "Range":
        """Wide enough for this value, too."""
        if not isfinite(value):
            raise ConfigError(f"a setting of {value} cannot be tuned: must be a finite number")
        log = self.log and value > 0.0
        return replace(self, low=min(self.low, value), high=max(self.high, value), log=log)


RANGES: Final[Mapping[str, Range]] = {
    f"{WEIGHTS}drag_fluctuation": Range(low=0.0, high=0.4),
    f"{WEIGHTS}lift": Range(low=0.02, high=0.3, log=True),
    f"{WEIGHTS}lift_mean": Range(low=0.0, high=1.0),
    f"{WEIGHTS}smoothness": Range(low=0.5, high=64.0, log=True),
    f"{WEIGHTS}effort": Range(low=0.0, high=10.0),
    f"{WEIGHTS}rate": Range(low=0.0, high=20.0),
    LEARNING_RATE: Range(low=8e-4, high=4e-3, log=True),
    HORIZON: Range(low=20, high=40, whole=True),
}
"""`mpc.weights.drag_mean` is missing: one weight is the unit of the others. The ends are where the truck's loop is
known to lose: with a horizon of 15 there is no reduction, and an effort of 20 costs a fifth of it."""


def is_weight(name: str) -> bool:
    """Whether a released controller takes the setting as an input; the others are fixed in its graph."""
    return name.startswith(WEIGHTS)


def chosen(names: Sequence[str], *, weights_only: bool) -> tuple[str, ...]:
    """The settings to tune: those that were named, or all that can be tuned.

    Args:
        names: whole, such as mpc.weights.lift, or by their last word.
        weights_only: whether only the weights can.

    Raises:
        ConfigError: for another name, a name given twice, or one that needs a model.
    """
    possible = [name for name in RANGES if is_weight(name) or not weights_only]
    found = []
    for name in names:
        whole = next((one for one in RANGES if name in (one, one.rpartition(".")[2])), None)
        if whole is None:
            words = ", ".join(one.rpartition(".")[2] for one in RANGES)
            raise ConfigError(f"--vary {name}: cannot be tuned; one of {words}")
        if whole not in possible:
            raise ConfigError(f"--vary {name}: fixed in the bundle's graph; name the bundle's model with --model")
        if whole in found:
            raise ConfigError(f"--vary {name}: given twice")
        found.append(whole)
    return tuple(name for name in possible if name in found or not names)


def parsed(text: str, present: MpcConfig, names: Sequence[str]) -> dict[str, float]:
    """Settings to be tried, of a text such as `lift=0.2,horizon=30`; what it does not name has its present value.

    Raises:
        ConfigError: for a name that is not varied, or a value that is no number or out of bounds.
    """
    values = values_of(present, names)
    for item in text.split(","):
        word, _, number = item.partition("=")
        name = next((one for one in names if word in (one, one.rpartition(".")[2])), None)
        if name is None:
            words = ", ".join(one.rpartition(".")[2] for one in names)
            raise ConfigError(f"--try {text}: {word!r} is not varied; of {words}")
        try:
            values[name] = float(number)
        except ValueError as error:
            raise ConfigError(f"--try {text}: {number!r} is no number") from error
        allowed = RANGES[name].with_value(values_of(present, names)[name])
        if not allowed.low <= values[name] <= allowed.high or (allowed.whole and values[name] != round(values[name])):
            kind = "a whole number " if allowed.whole else ""
            raise ConfigError(f"--try {text}: {word} must be {kind}from {allowed.low:g} to {allowed.high:g}")
        if allowed.whole:
            values[name] = round(values[name])
    return values


def ranges_around(present: MpcConfig, names: Sequence[str]) -> dict[str, Range]:
    """The range of each setting, wide enough for the present one."""
    values = values_of(present, names)
    return {name: RANGES[name].with_value(values[name]) for name in names}


def values_of(mpc: MpcConfig, names: Sequence[str]) -> dict[str, float]:
    """The settings of these names."""
    return {
        name: getattr(mpc.weights, name.removeprefix(WEIGHTS))
        if is_weight(name)
        else getattr(mpc, name.removeprefix("mpc."))
        for name in names
    }


def with_values(mpc: MpcConfig, values: Values) -> MpcConfig:
    """The settings with these in their place."""
    weights = {name.removeprefix(WEIGHTS): value for name, value in values.items() if is_weight(name)}
    others = {name.removeprefix("mpc."): value for name, value in values.items() if not is_weight(name)}
    if "horizon" in others:
        others["horizon"] = round(others["horizon"])
    return replace(mpc, weights=replace(mpc.weights, **weights), **others)  # type: ignore[arg-type]


def rounded(value: float) -> float:
    """To three digits: no loop is sensitive to a fourth, and a command stays short."""
    return float(f"{value:.{_DIGITS}g}")


def changed(before: MpcConfig, after: MpcConfig) -> dict[str, float]:
    """What differs of everything that can be tuned, by name, with the new values."""
    old, new = values_of(before, tuple(RANGES)), values_of(after, tuple(RANGES))
    return {name: new[name] for name in RANGES if old[name] != new[name]}
