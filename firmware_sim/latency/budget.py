"""A latency budget: limits in a TOML file, held against what was measured."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from contract.errors import ConfigError
from firmware_sim.latency.quantiles import Quantiles
from firmware_sim.latency.stages import Stage

LIMITS: Final[Mapping[str, str]] = {"p50_ms": "p50", "p99_ms": "p99", "p99_9_ms": "p99_9", "max_ms": "max"}
"""What may be limited of a stage, and the field of `Quantiles` that it limits."""
COUNTS: Final = ("misses", "misses_ours")
"""What may be limited of a run as a whole: all misses, and those beyond the idle loop's."""
LARGEST_FILE: Final = 2**16
"""Bytes."""
LONGEST_MS: Final = 86_400_000


@dataclass(frozen=True, kw_only=True)
class Budget:
    """The most that is allowed.

    Attributes:
        counts: those of `COUNTS` that are limited.
        latencies: ms by stage and name of the limit.
    """

    counts: Mapping[str, int]
    latencies: Mapping[tuple[Stage, str], float]


class Verdict(NamedTuple):
    """One limit, held against what was measured.

    Attributes:
        name: such as `all.p99_ms`.
        allowed: the most.
        measured: None where the stage did not happen.
    """

    name: str
    allowed: float
    measured: float | None

    @property
    def is_kept(self) -> bool:
        """A stage that did not happen kept nothing."""
        return self.measured is not None and self.measured <= self.allowed


def read_budget(path: Path) -> Budget:
    """The budget of a file.

    Raises:
        ConfigError: it cannot be read, limits something unknown or nothing, or a limit is out of range.
    """
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_FILE + 1)
        if len(text) > LARGEST_FILE:
            raise ConfigError(f"budget {path}: more than {LARGEST_FILE} bytes")
        tree = tomllib.loads(text.decode())
    except OSError as error:
        raise ConfigError(f"budget {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"budget {path}: not TOML: {error}") from error
    counts: dict[str, int] = {}
    latencies: dict[tuple[Stage, str], float] = {}
    for name, value in tree.items():
        if name in COUNTS:
            counts[name] = _count(path, name, value)
        elif name in list(Stage) and isinstance(value, dict):
            latencies |= {(Stage(name), limit): _ms(path, f"{name}.{limit}", limit, ms) for limit, ms in value.items()}
        else:
            known = ", ".join((*COUNTS, *(f"[{stage}]" for stage in Stage)))
            raise ConfigError(f"budget {path}: {name!r} cannot be limited: must be one of {known}")
    if not counts and not latencies:
        raise ConfigError(f"budget {path}: it limits nothing; for example misses_ours = 0")
    return Budget(counts=counts, latencies=latencies)


def verdicts(budget: Budget, counts: Mapping[str, int], latencies: Mapping[Stage, Quantiles]) -> list[Verdict]:
    """Each limit of the budget with what was measured.

    Args:
        budget: the limits.
        counts: all of `COUNTS`.
        latencies: of every stage.
    """
    judged = [Verdict(name, allowed, counts[name]) for name, allowed in budget.counts.items()]
    for (stage, limit), allowed in budget.latencies.items():
        judged.append(Verdict(f"{stage}.{limit}", allowed, getattr(latencies[stage], LIMITS[limit])))
    return judged


def _count(path: Path, name: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**53:
        raise ConfigError(f"budget {path}: {name} = {_short(value)}: must be a whole number, at least 0")
    return value


def _ms(path: Path, name: str, limit: str, value: Any) -> float:
    if limit not in LIMITS:
        raise ConfigError(f"budget {path}: {name} is not known: must be one of {', '.join(LIMITS)}")
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not 0 < value <= LONGEST_MS:
        raise ConfigError(
            f"budget {path}: {name} = {_short(value)}: must be a number of ms, positive and at most a day"
        )
    return float(value)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
