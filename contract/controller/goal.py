"""The goal as the prior's input: the weights of effort and lift relative to drag, and the limit of the jets.

The prior of the plan is trained for a range of goals (`train.refinement`); in every control step it gets the position
of the present goal in that range, and of its nearest end for a goal outside. The MPC iterations take over every term of
the cost that the prior was not trained for (`unknown_to_prior`).
"""

from dataclasses import replace
from math import sqrt
from typing import Final, NamedTuple

from contract.config.controller import CostWeights

DEAREST_EFFORT: Final = 9.0
"""Largest weight of effort, relative to a weight of 1 on drag, that a prior is trained for, in Cd per (U_inf W)^2. The
prior that was trained up to 100 needed the least power of the jets at about 9."""
DEAREST_LIFT: Final = 1.0
"""Largest weight of lift, relative to a weight of 1 on drag, that a prior is trained for, in Cd per |Cl|."""
NARROWEST: Final = 0.5
"""Smallest limit of the jets that a prior is trained for, as a share of the release's limit."""
SPEED_SCALE: Final = 0.4
"""Difference between a vehicle's speed and the design speed that is scaled to 1, in units of the design speed."""
SCHEDULED: Final = ("one", "speed", "effort", "lift", "limit")
"""Names of the scheduling inputs of a prior's units, in the order of its tensors: 1, the scaled speed, the parts of the
goal. The sums of sensors are inputs too."""


class Goal(NamedTuple):
    """A position in the range of goals; each part is between 0 and 1.

    Attributes:
        effort: root of the weight on effort over `DEAREST_EFFORT`.
        lift: root of the weight on lift over `DEAREST_LIFT`.
        limit: 0 at the release's own limit of the jets, 1 at `NARROWEST` times that limit and below.
    """

    effort: float = 0.0
    lift: float = 0.0
    limit: float = 0.0

    @classmethod
    def of(cls, weights: CostWeights, share_of_limit: float = 1.0) -> "Goal":
        """Compute the position of weights and a jet limit in the range; the limit is a share of the release's."""
        return cls(
            effort=_root(weights.effort, weights.drag_mean * DEAREST_EFFORT),
            lift=_root(weights.lift, weights.drag_mean * DEAREST_LIFT),
            limit=min(1.0, max(0.0, (1.0 - share_of_limit) / (1.0 - NARROWEST))),
        )

    def prices(self) -> tuple[float, float]:
        """Return the weights of effort and lift relative to a weight of 1 on drag."""
        return DEAREST_EFFORT * self.effort**2, DEAREST_LIFT * self.lift**2

    def share_of_limit(self) -> float:
        """Return the limit of the jets as a share of the release's limit."""
        return 1.0 - (1.0 - NARROWEST) * self.limit


OWN: Final = Goal()
"""The goal of drag reduction alone, with the release's full limit of the jets."""


def schedule(speed: float, goal: Goal) -> tuple[float, ...]:
    """Return the values of `SCHEDULED` for a goal at a speed in units of the design speed."""
    return (1.0, (speed - 1.0) / SPEED_SCALE, *goal)


def unknown_to_prior(weights: CostWeights, *, knows_goal: bool = True) -> CostWeights:
    """Return the weights for MPC iterations from a prior's plan: those of terms that the prior does not know.

    A prior that was trained through the flow is stationary for the goals in its range: the expected gradient of their
    cost along its plan is zero. A gradient that the model computes for them is noise and error, so their weights are
    removed. A goal outside the range gets no iterations either: with four times the largest weight of lift they
    increased the cost by 12 % (4 to 21 % in three pairs of runs), with four times that of effort they gained nothing.

    A prior trained for drag alone gets no other goal, so the iterations keep the weights of effort and lift.
    """
    known = replace(weights, drag_mean=0.0)
    return replace(known, effort=0.0, lift=0.0) if knows_goal else known


def _root(weight: float, dearest: float) -> float:
    return sqrt(weight / dearest) if weight < dearest else float(weight > 0.0)
