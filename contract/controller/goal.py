"""The goal of the control as the prior reads it: the weights of effort and lift relative to drag, and the jets' limit.

The prior, a network that computes the MPC's initial plan, is trained for a range of goals (`train.refinement`). In
every control step it reads the present goal's position in that range; outside the range it reads the nearest end. The
MPC iterations optimise only the terms of the cost for which the prior was not trained (`unknown_to_prior`).
"""

from dataclasses import replace
from math import sqrt
from typing import Final, NamedTuple

import numpy as np

from contract.arrays import Array
from contract.config.controller import CostWeights

DEAREST_EFFORT: Final = 9.0
"""Largest weight of effort for which a prior is trained, relative to a weight of 1 on drag, in Cd per (U_inf W)^2. With
a prior that was trained with weights up to 100, the jets took the least power at a weight of about 9."""
DEAREST_LIFT: Final = 1.0
"""Largest weight of lift for which a prior is trained, relative to a weight of 1 on drag, in Cd per |Cl|."""
NARROWEST: Final = 0.5
"""Smallest limit of the jets for which a prior is trained, as a share of the release's limit."""
SPEED_SCALE: Final = 0.4
"""Difference from the design speed that the prior reads as 1, as a share of the design speed."""
SCHEDULED: Final = ("one", "slower", "faster", "effort", "lift", "limit")
"""Names of the variables that schedule a prior's units, in the order of its tensors: the constant 1, the scaled speed
below and above the design speed, and the parts of the goal. A gate also depends on filtered sums of pressures."""
SPEED_PLACES: Final = (SCHEDULED.index("slower"), SCHEDULED.index("faster"))
"""Indices of the speed variables. With one variable, more training at high speeds made a prior worse at low speeds."""


class Goal(NamedTuple):
    """A position in the range of goals. Each part of the position is between 0 and 1. `effort` and `lift` are sqrt(w /
    `DEAREST_EFFORT`) and sqrt(w / `DEAREST_LIFT`) for a weight w relative to a weight of 1 on drag. `limit` is 0 if the
    jets have the release's limit, 1 if they have at most `NARROWEST` times the release's limit."""

    effort: float = 0.0
    lift: float = 0.0
    limit: float = 0.0

    @classmethod
    def of(cls, weights: CostWeights, share_of_limit: float = 1.0) -> "Goal":
        """Compute the goal from the cost weights and the jets' limit. The limit is a share of the release's limit."""
        return cls(
            effort=_root(weights.effort, weights.drag_mean * DEAREST_EFFORT),
            lift=_root(weights.lift, weights.drag_mean * DEAREST_LIFT),
            limit=min(1.0, max(0.0, (1.0 - share_of_limit) / (1.0 - NARROWEST))),
        )

    def prices(self) -> tuple[float, float]:
        """Return the weights of effort and lift, relative to a weight of 1 on drag, at this position."""
        return DEAREST_EFFORT * self.effort**2, DEAREST_LIFT * self.lift**2

    def share_of_limit(self) -> float:
        """Return the limit of the jets as a share of the release's limit."""
        return 1.0 - (1.0 - NARROWEST) * self.limit


OWN: Final = Goal()
"""The goal of drag reduction alone, with the release's full limit of the jets."""


def schedule(speed: float, goal: Goal) -> tuple[float, ...]:
    """Return the values of the variables in `SCHEDULED`. `speed` is a ratio to the design speed."""
    scaled = (speed - 1.0) / SPEED_SCALE
    return (1.0, min(scaled, 0.0), max(scaled, 0.0), *goal)


def of_two_speeds(parts: Array) -> Array:
    """Return a prior's scheduled weights with the variables of `SCHEDULED` along the first axis. If the prior has one
    speed variable, as in `truck-wake-13`, the weights of this variable are used for both speed variables."""
    below, above = SPEED_PLACES
    return np.insert(parts, above, parts[below], axis=0) if len(parts) == len(SCHEDULED) - 1 else parts


def unknown_to_prior(weights: CostWeights, *, knows_goal: bool = True) -> CostWeights:
    """Return the weights for MPC iterations that start from a prior's plan: zero for terms for which it was trained.

    A prior is trained with gradients through the flow, so the true gradient of the cost at its plan is zero for goals
    in the trained range. The model's gradient at this plan consists of noise and model error. Iterations do not help
    outside this range either: with a lift weight of four times `DEAREST_LIFT`, they increased the cost by 12 % (4 to 21
    % in three pairs of runs); with four times `DEAREST_EFFORT`, they did not lower it. A prior for drag alone has no
    input for other goals, so the iterations keep the weights of effort and lift."""
    known = replace(weights, drag_mean=0.0)
    return replace(known, effort=0.0, lift=0.0) if knows_goal else known


def _root(weight: float, dearest: float) -> float:
    return sqrt(weight / dearest) if weight < dearest else float(weight > 0.0)
