"""What a prior knows of the goal: how dear effort and lift are beside drag, and how far the jets may go.

The prior of the plan is trained for a range of goals (`train.refinement`); in every control step it is told where in
that range the present one lies. What is asked beyond the range, and every term of the cost that the prior does not
know, is left to the iterations (`beyond`).
"""

from dataclasses import replace
from math import sqrt
from typing import Final, NamedTuple

from contract.config.controller import CostWeights

DEAREST_EFFORT: Final = 9.0
"""The largest weight on effort beside one of 1 on drag that a prior is trained for, in Cd per (U_inf W)^2. Beyond it,
less power of the jets is not bought any more: a prior that was trained up to 100 had the least at 11."""
DEAREST_LIFT: Final = 1.0
"""The same of the weight on lift, in Cd per |Cl|."""
NARROWEST: Final = 0.5
"""The least limit of the jets that it is trained for, as a share of the release's."""
SPEED_SCALE: Final = 0.4
"""The scale of the speed less the design speed, in design speeds: how far a vehicle's may be from it."""
SCHEDULED: Final = ("one", "speed", "effort", "lift", "limit")
"""What schedules a prior's units besides the sums, in the order of its tensors: 1, the scaled speed, a goal's parts."""


class Goal(NamedTuple):
    """A place in the range, each part from 0 to 1.

    Attributes:
        effort: root of the weight on effort over `DEAREST_EFFORT`.
        lift: root of the weight on lift over `DEAREST_LIFT`.
        limit: how far the jets' limit is narrowed: 0 at the release's own, 1 at `NARROWEST` of it and below.
    """

    effort: float = 0.0
    lift: float = 0.0
    limit: float = 0.0

    @classmethod
    def of(cls, weights: CostWeights, share_of_limit: float = 1.0) -> "Goal":
        """Where weights and a limit of the jets, as a share of the release's, lie in the range."""
        return cls(
            effort=_root(weights.effort, weights.drag_mean * DEAREST_EFFORT),
            lift=_root(weights.lift, weights.drag_mean * DEAREST_LIFT),
            limit=min(1.0, max(0.0, (1.0 - share_of_limit) / (1.0 - NARROWEST))),
        )

    def prices(self) -> tuple[float, float]:
        """Weights on effort and lift beside one of 1 on drag."""
        return DEAREST_EFFORT * self.effort**2, DEAREST_LIFT * self.lift**2

    def share_of_limit(self) -> float:
        """The limit of the jets as a share of the release's."""
        return 1.0 - (1.0 - NARROWEST) * self.limit


OWN: Final = Goal()
"""Drag alone, with all that the jets can do."""


def schedule(speed: float, goal: Goal) -> tuple[float, ...]:
    """The values of `SCHEDULED` at a speed in design speeds, for a goal."""
    return (1.0, (speed - 1.0) / SPEED_SCALE, *goal)


def beyond(weights: CostWeights, *, knows_goal: bool = True) -> CostWeights:
    """The weights that the iterations take where a plan starts at a prior: what is asked beyond its range of goals.

    A prior that was trained for drag alone knows no other goal, and leaves effort and lift to the iterations whole.

    A prior that was trained through the flow is stationary for the goals that it knows. The expected slope of their
    cost along its plan is zero, so what a model finds of such a slope is noise and error. Of what is asked beyond the
    range, and of the terms that the prior does not know, the whole slope remains.
    """
    drag = weights.drag_mean if knows_goal else 0.0
    return replace(
        weights,
        drag_mean=0.0,
        effort=max(0.0, weights.effort - DEAREST_EFFORT * drag),
        lift=max(0.0, weights.lift - DEAREST_LIFT * drag),
    )


def _root(weight: float, dearest: float) -> float:
    return sqrt(weight / dearest) if weight < dearest else float(weight > 0.0)
