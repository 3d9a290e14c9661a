"""Settings of the model predictive controller."""

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Annotated

from contract.config.rules import STEPS, AtLeastOne, Finite, NonNegative, Positive, Settings, at_least, ours, paper


@dataclass(frozen=True, kw_only=True)
class CostWeights(Settings, section="mpc.weights", source=paper("section 2.4.1")):
    """Weights of the MPC cost J (paper, section 2.4.1); forces and actions in physical units."""

    drag_mean: Annotated[NonNegative[float], paper("equation 13", "the term has no factor")] = 1.0
    """Weighs the horizon's mean C_d, less `mpc.drag_reference`."""
    drag_fluctuation: NonNegative[float] = 0.1
    """Weighs the largest C_d of the horizon less the smallest."""
    lift: NonNegative[float] = 0.01
    """Weighs the horizon's mean |C_l|."""
    lift_mean: Annotated[NonNegative[float], paper("equation 14", "without this term")] = 0.0
    """Weighs the square of the horizon's mean C_l. The horizon is one shedding cycle, so this mean is the steady
    deflection of the wake, which the paper's terms let the optimiser trade for drag."""
    smoothness: NonNegative[float] = 8.0
    """Weighs the mean squared step between the plan's consecutive actions."""
    effort: Annotated[NonNegative[float], paper("equation 15", "without this term")] = 0.0
    """Weighs the plan's mean squared action."""
    rate: Annotated[NonNegative[float], paper("equation 15", "without this term")] = 0.0
    """Weighs the squared step from the action in force to the first planned one."""
    prior: Annotated[NonNegative[float], paper("equation 15", "without this term")] = 0.0
    """Weighs the plan's mean squared distance from where the optimiser starts: the prior's plan, or where a model has
    no prior the shifted previous one."""

    def as_tuple(self) -> tuple[float, ...]:
        """Weights in declaration order, the order of the controller's `weights` input."""
        return tuple(float(getattr(self, item.name)) for item in fields(self))

    @classmethod
    def of(cls, values: Iterable[float]) -> "CostWeights":
        """The weights that `as_tuple` gives; raises ConfigError for a value below zero."""
        return cls(**{item.name: float(value) for item, value in zip(fields(cls), values, strict=True)})


@dataclass(frozen=True, kw_only=True)
class MpcConfig(Settings, source=paper("section 2.4.2")):
    """The fixed-iteration optimiser (paper, section 2.4)."""

    horizon: Annotated[int, at_least(2), STEPS, paper("section 2.4")] = 25
    """H: how far the optimiser looks ahead; about one shedding cycle."""
    iterations: AtLeastOne[int] = 5
    """Steps of Adam on the plan in each control step."""
    learning_rate: Positive[float] = 1e-3
    """Learning rate of these steps of Adam."""
    epsilon: Annotated[Positive[float], ours("Kingma and Ba's; the paper gives none")] = 1e-8
    """What Adam adds to the root of the second moment. Far below the gradients a first step is a whole learning
    rate, far above them it is the gradient times `mpc.learning_rate` over this."""
    drag_reference: Annotated[Finite[float], paper("section 2.4.1")] = 1.051
    """C_d,ref: mean drag without control. It shifts the cost, and changes no plan."""
    weights: CostWeights = field(default_factory=CostWeights)
