"""How a model's sensors were chosen, as its description keeps it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from contract.typed import typed
from train.selection.ranking import Ranking

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
