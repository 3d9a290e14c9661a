"""A latency budget: limits from a TOML file, compared with measured values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, make_dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

from contract.errors import ConfigError
from contract.typed import read_toml, typed
from firmware_sim.latency.measured import Quantiles
from firmware_sim.latency.stages import Stage

COUNTS: Final = ("misses", "misses_ours")
"""Counts over a whole run that a budget may limit: missed commands, and their excess over the idle loop's misses."""


@dataclass(frozen=True, kw_only=True)
class StageLimits:
    """Upper limits of the latency figures of one stage, in ms; None for no limit."""

    p50_ms: float | None = None
    p99_ms: float | None = None
    p99_9_ms: float | None = None
    max_ms: float | None = None


_Form: Final[Any] = make_dataclass(
    "_Form",
    [
        *((name, int | None, field(default=None)) for name in COUNTS),
        *((stage.value, StageLimits, field(default=StageLimits())) for stage in Stage),
    ],
)


class KeptLimit(NamedTuple):
    """The limit of a figure and its measured value, which is None if the stage did not occur."""

    name: str
    allowed: float
    measured: float | None

    @property
    def is_kept(self) -> bool:
        return self.measured is not None and self.measured <= self.allowed


def read_budget(path: Path) -> dict[str, float]:
    """Read the limits of figures such as `all.p99_ms`. Raises ConfigError for a wrong or missing limit."""
    tree = read_toml(path, "budget")
    try:
        form = typed(tree, _Form)
    except ConfigError as error:
        raise ConfigError(f"budget {path}: {error}") from error
    of_stages = {f"{stage}.{name}": most for stage in Stage for name, most in vars(getattr(form, stage)).items()}
    limits = {name: getattr(form, name) for name in COUNTS} | of_stages
    budget = {name: most for name, most in limits.items() if most is not None}
    for name, most in budget.items():
        if name in COUNTS and most < 0:
            raise ConfigError(f"budget {path}: {name} = {most}: must be at least 0")
        if name in of_stages and not (isfinite(most) and most > 0.0):
            raise ConfigError(f"budget {path}: {name} = {most}: must be a positive number of ms")
    if not budget:
        raise ConfigError(f"budget {path}: has no limit; write a limit, for example misses_ours = 0")
    return budget


def verdicts(
    budget: Mapping[str, float], counts: Mapping[str, int], latencies: Mapping[Stage, Quantiles]
) -> list[KeptLimit]:
    measured: dict[str, float | None] = dict(counts)
    for stage, found in latencies.items():
        measured |= {f"{stage}.{name}_ms": value for name, value in found._asdict().items()}
    return [KeptLimit(name, allowed, measured[name]) for name, allowed in budget.items()]
