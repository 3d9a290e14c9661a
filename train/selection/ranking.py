"""Scores of the sensors over repeated draws: the best sensors, and how stable they are (paper, appendix C)."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from contract.arrays import Array, Index
from contract.sensors import NAMES
from train.selection.budget import check_count


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
