"""Settings of the model predictive controller.

Not in the paper: `CostWeights.lift_mean`.
"""

from dataclasses import dataclass, field, fields
from typing import Annotated

from contract.config.rules import AtLeastOne, Finite, NonNegative, Positive, Settings, at_least
from contract.config.units import STEPS


@dataclass(frozen=True, kw_only=True)
class CostWeights(Settings, section="mpc.weights"):
    """Weights of the MPC cost J (paper, equations 9-11); forces and actions in physical units."""

    drag_mean: NonNegative[float] = 1.0
    drag_fluctuation: NonNegative[float] = 0.1
    lift: NonNegative[float] = 0.01
    lift_mean: NonNegative[float] = 0.0
    """On the square of the horizon's mean C_l. The horizon is one shedding cycle, so this mean is the steady
    deflection of the wake, which the paper's terms let the optimiser trade for drag."""
    smoothness: NonNegative[float] = 8.0
    effort: NonNegative[float] = 0.0
    rate: NonNegative[float] = 0.0
    """On the squared step from the action in force to the first planned one."""

    def as_tuple(self) -> tuple[float, ...]:
        """Weights in declaration order, the order of the controller's `weights` input."""
        return tuple(float(getattr(self, item.name)) for item in fields(self))


@dataclass(frozen=True, kw_only=True)
class MpcConfig(Settings):
    """The fixed-iteration optimiser (paper, section 2.4)."""

    horizon: Annotated[int, at_least(2), STEPS] = 25
    iterations: AtLeastOne[int] = 5
    learning_rate: Positive[float] = 1e-3
    drag_reference: Finite[float] = 1.051
    weights: CostWeights = field(default_factory=CostWeights)
