"""Scores of the sensors over repeated draws: the best sensors, and how stable they are (paper, appendix C)."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from contract.arrays import Array, Index
from contract.errors import ConfigError
from contract.sensors import NAMES
from contract.typed import typed


def check_count(count: int, available: int) -> None:
    """Raises ConfigError if there are not that many sensors among those that are available."""
    if not 1 <= count <= available:
        raise ConfigError(f"train.sensors = {count}: must be from 1 to {available}, the sensors that there are")


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranking:
    """Scores of repeated draws.

    Attributes:
        scores: (repeats, N).
        names: of the N sensors, in the order of the scores.
    """

    scores: Array
    names: tuple[str, ...] = NAMES

    @property
    def mean(self) -> Array:
        """(N,) mean over the repeats."""
        mean: Array = self.scores.mean(axis=0)
        return mean

    @property
    def std(self) -> Array:
        """(N,) sample standard deviation over the repeats; zero for a single one."""
        return self.scores.std(axis=0, ddof=1) if len(self.scores) > 1 else np.zeros(self.scores.shape[1])

    def top(self, count: int) -> tuple[str, ...]:
        """Names of the best sensors by mean score, best first; equal scores keep the sensors' order. Raises ConfigError
        if there are not that many sensors."""
        check_count(count, len(self.names))
        return self._names(_best(self.mean, count))

    def top_sets(self, count: int) -> tuple[frozenset[str], ...]:
        """The set of the best sensors in each repeat."""
        return tuple(frozenset(self._names(_best(scores, count))) for scores in self.scores)

    def is_stable(self, count: int) -> bool:
        """Whether every repeat has the same set of best sensors."""
        return len(set(self.top_sets(count))) == 1

    def differences(self, count: int) -> Mapping[str, float]:
        """Share of the repeats that have a sensor among their best, for those that some have and others not.

        In the sensors' order; empty if the set is stable.
        """
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
"""The method of a choice that the caller made."""


@dataclass(frozen=True, kw_only=True)
class SensorChoice:
    """Method and outcome. All but `method` and `order` are SHAP's, and None for the other methods.

    Attributes:
        method: "shap.GradientExplainer", another of `train.selection.methods.METHODS`, or "given".
        repeats: of the ranking.
        order: all names, best first, of SHAP; the chosen ones of the others.
        mean: (N,) scores over the repeats.
        std: (N,) of them.
        stable: by size of the best set, whether it is the same in every repeat.
        differences: by that size, the share of the repeats in which a sensor is among the best, for those that are in
            some and not in others.
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
        """The choice by the paper's method."""
        # The set of all sensors is always stable.
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

    def as_tree(self) -> dict[str, Any]:
        """Plain values for JSON; without those that are None."""
        tree = {name: value for name, value in asdict(self).items() if value is not None}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in tree.items()}

    @classmethod
    def from_tree(cls, tree: Mapping[str, Any]) -> "SensorChoice":
        """Back from `as_tree`; raises ConfigError for a tree of another form."""
        return typed(tree, cls)
