"""Numbers as options take them: those that no later step could use are refused by the option's name."""

from math import isfinite

from contract.errors import ConfigError


def check_positive(option: str, value: float) -> None:
    """Raise ConfigError for nan, infinity, zero or a negative number."""
    if not (isfinite(value) and value > 0.0):
        raise ConfigError(f"{option} {value:g}: must be a positive number")


def check_seed(option: str, value: int) -> None:
    """Raise ConfigError for a negative number, which no random generator takes."""
    if value < 0:
        raise ConfigError(f"{option} {value}: must be 0 or more")


def check_finite(option: str, value: float) -> None:
    """Raise ConfigError for nan or infinity."""
    if not isfinite(value):
        raise ConfigError(f"{option} {value:g}: must be a finite number")
