"""The scores of the sensors in repeated rankings: the best sensors, and their stability (paper, appendix C)."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contract.arrays import Array, Index
from contract.errors import ConfigError
from contract.sensors import NAMES


def check_count(count: int, available: int) -> None:
    """Raise ConfigError unless the count is at least 1 and at most the number of available sensors."""
    if not 1 <= count <= available:
        raise ConfigError(f"train.sensors = {count}: must be from 1 to {available}, the number of sensors")


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranking:
    """The scores of the sensors. Each repeat draws other training windows at random and scores all sensors again.

    Attributes:
        scores: (repeats, N).
        names: names of the N sensors, in the order of the scores.
    """

    scores: Array
    names: tuple[str, ...] = NAMES

    @property
    def mean(self) -> Array:
        """Mean of the N sensors' scores over the repeats, (N,)."""
        mean: Array = self.scores.mean(axis=0)
        return mean

    @property
    def std(self) -> Array:
        """Sample standard deviation of the N sensors' scores over the repeats, (N,); zero for a single repeat."""
        return self.scores.std(axis=0, ddof=1) if len(self.scores) > 1 else np.zeros(self.scores.shape[1])

    def top(self, count: int) -> tuple[str, ...]:
        """Return the names of the best sensors by mean score, best first; equal scores keep the sensors' order. Raises
        ConfigError if there are fewer sensors than `count`."""
        check_count(count, len(self.names))
        return self._names(_best(self.mean, count))

    def top_sets(self, count: int) -> tuple[frozenset[str], ...]:
        """Return the set of the best sensors in each repeat."""
        return tuple(frozenset(self._names(_best(scores, count))) for scores in self.scores)

    def is_stable(self, count: int) -> bool:
        """Return whether every repeat has the same set of best sensors."""
        return len(set(self.top_sets(count))) == 1

    def differences(self, count: int) -> Mapping[str, float]:
        """Return the sensors that are among the best in some repeats only, each with the fraction of these repeats. The
        sensors are in the order of `names`; the result is empty if the set is stable."""
        repeats = len(self.scores)
        counts = Counter(name for names in self.top_sets(count) for name in names)
        return {name: counts[name] / repeats for name in self.names if 0 < counts[name] < repeats}

    def _names(self, chosen: Sequence[int] | Index) -> tuple[str, ...]:
        return tuple(self.names[index] for index in chosen)


def _best(scores: Array, count: int) -> Index:
    return np.argsort(-scores, kind="stable")[:count]


STABILITY_SETS: Final = (2, 4, 6, 8)
"""Sizes of the best sets whose stability over the repeats is reported (paper, appendix C)."""

GIVEN: Final = "given"
"""Name of the method if the caller chose the sensors."""


@dataclass(frozen=True, kw_only=True)
class SensorChoice:
    """The chosen sensors and the method. Fields other than `method` and `order` are None except for SHAP.

    Attributes:
        method: "shap.GradientExplainer", another of `train.selection.methods.METHODS`, or "given".
        repeats: number of repeats of the ranking.
        order: names of sensors: for SHAP the names of all sensors, best first; for the other methods the chosen names.
        mean, std: (N,) mean and standard deviation of the N sensors' scores over the repeats.
        stable: whether the best set is equal in all repeats, by size of the set.
        differences: `Ranking.differences` by size of the set.
    """

    method: str
    repeats: int | None = None
    order: tuple[str, ...]
    mean: tuple[float, ...] | None = None
    std: tuple[float, ...] | None = None
    stable: Mapping[str, bool] | None = None
    differences: Mapping[str, Mapping[str, float]] | None = None

    @classmethod
    def of_ranking(cls, ranking: Ranking) -> "SensorChoice":
        """Build the choice from a ranking by the paper's method."""
        # The set of all sensors is always stable, so its size is left out.
        sizes = [count for count in STABILITY_SETS if count < len(ranking.names)]
        return cls(
            method="shap.GradientExplainer",
            repeats=len(ranking.scores),
            order=ranking.top(len(ranking.names)),
            mean=tuple(ranking.mean.tolist()),
            std=tuple(ranking.std.tolist()),
            stable={str(count): ranking.is_stable(count) for count in sizes},
            differences={str(count): dict(ranking.differences(count)) for count in sizes},
        )
