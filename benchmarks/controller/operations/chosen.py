"""The roads that are measured, with their constants.

Where the paper has none for a road, its constants are the best of a ladder, a factor of three between rungs, on the
first round of recordings under control: by the mean cost of the plans along them.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from benchmarks.controller.operations.road import (
    Blocked,
    Newton,
    Proposal,
    Road,
    Rule,
    adam,
    heavy_ball,
    lift_curvature,
)
from benchmarks.controller.operations.sequences import Sequences
from benchmarks.controller.situations import LEAD
from contract.arrays import Array

REACH: Final = 5.1e-3
"""Iterations times learning rate of the release: how far a control step may move an action."""
RELEASE: Final = Road(name="Adam", rule=adam, rate=REACH / 3, iterations=3)
IN_THE_LOOP: Final = (
    ("Adam", 1),
    ("Adam", 2),
    ("Adam", 3),
    ("Adam, 13 blocks", 2),
    ("fixed Gauss-Newton", 1),
    ("fixed Gauss-Newton, half the step", 1),
    ("fixed Gauss-Newton, half the step", 2),
    ("Gauss-Newton", 1),
)
"""Names and iterations of the roads that close the loop."""


def chosen_roads(curvature: Array, proposal: Proposal) -> Sequence[Road]:
    """All of them, given the average curvature of the lift terms, (2, H, H), and a learned warm start."""

    def of_adam(name: str, iterations: int, rule: Rule = adam, reach: float = REACH) -> Road:
        return Road(name=name, rule=rule, rate=reach / iterations, iterations=iterations)

    def kept(name: str, iterations: int, rule: Rule, rate: float) -> Road:
        return Road(name=name, rule=rule, rate=rate, iterations=iterations, carried=True)

    def newton(name: str, iterations: int, rule: Newton, rate: float) -> Road:
        return Road(name=name, rule=rule, rate=rate, iterations=iterations)

    return (
        *(of_adam("Adam", n) for n in (1, 2, 3, 5, 10)),
        *(of_adam("Adam, twice the reach", n, reach=2.0 * REACH) for n in (2, 3)),
        *(kept("Adam, moments kept", n, adam, rate) for n, rate in ((1, 0.004), (3, 0.01))),
        *(Road(name="heavy ball", rule=heavy_ball, rate=rate, iterations=n) for n, rate in ((1, 0.03), (3, 0.01))),
        *(kept("heavy ball, velocity kept", n, heavy_ball, rate) for n, rate in ((1, 0.03), (3, 0.01))),
        *(of_adam(f"Adam, {blocks} blocks", n, Blocked(blocks)) for blocks in (5, 8, 13) for n in (2, 3)),
        *(newton("tridiagonal", n, Newton(30.0, "none"), 1.0) for n in (1, 2)),
        *(newton("Gauss-Newton", n, Newton(1.0, "exact"), 0.5) for n in (1, 2)),
        *(newton("fixed Gauss-Newton", n, Newton(1.0, curvature), 1.0) for n in (1, 2)),
        *(newton("fixed Gauss-Newton, half the step", n, Newton(1.0, curvature), 0.5) for n in (1, 2)),
        *(
            Road(name="Adam, learned start", rule=adam, rate=REACH / n, iterations=n, proposal=proposal)
            for n in (1, 2, 3)
        ),
    )


def average_curvature(sequences: Sequences, weights: Array) -> Array:
    """`lift_curvature` on average along the release's plans, (2, H, H)."""
    travelled = list(sequences.travelled(RELEASE, weights))[LEAD::3]
    return np.asarray(np.mean([lift_curvature(problem, plans).mean(axis=1) for problem, plans in travelled], axis=0))
