"""The settings of the model predictive controller."""

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Annotated

from contract.config.notes import STEPS, ours, paper
from contract.config.rules import AtLeastOne, Finite, NonNegative, Positive, Settings, at_least


@dataclass(frozen=True, kw_only=True)
class CostWeights(Settings, section="mpc.weights", source=paper("section 2.4.1")):
    """The weights of the MPC cost J (paper, section 2.4.1). J is computed from forces and actions in physical units."""

    drag_mean: Annotated[NonNegative[float], paper("equation 13", "the term has no factor")] = 1.0
    """Weight of the difference between the mean C_d over the horizon and `mpc.drag_reference`."""
    drag_fluctuation: NonNegative[float] = 0.1
    """Weight of the range of C_d over the horizon: the largest minus the smallest value."""
    lift: NonNegative[float] = 0.01
    """Weight of the mean |C_l| over the horizon."""
    lift_mean: Annotated[NonNegative[float], paper("equation 14", "without this term")] = 0.0
    """Weight of the squared mean of C_l over the horizon. The horizon is one shedding cycle, so this mean is a steady
    deflection of the wake. With the paper's terms alone, the optimiser accepts this deflection to reduce drag."""
    smoothness: NonNegative[float] = 8.0
    """Weight of the mean squared difference between consecutive actions of the plan."""
    effort: Annotated[NonNegative[float], paper("equation 15", "without this term")] = 0.0
    """Weight of the mean squared action of the plan."""
    rate: Annotated[NonNegative[float], paper("equation 15", "without this term")] = 0.0
    """Weight of the squared difference between the present action of the jets and the first planned action."""
    prior: Annotated[NonNegative[float], paper("equation 15", "without this term")] = 0.0
    """Weight of the plan's mean squared distance from the optimiser's initial plan. The initial plan is the prior's
    plan or, without a prior, the previous plan shifted by one step."""

    def as_tuple(self) -> tuple[float, ...]:
        """Return the weights in declaration order, which is the order of the controller's `weights` input."""
        return tuple(float(getattr(self, item.name)) for item in fields(self))

    @classmethod
    def of(cls, values: Iterable[float]) -> "CostWeights":
        """Build the weights from values in the order of `as_tuple`. Raises ConfigError for a negative value."""
        return cls(**{item.name: float(value) for item, value in zip(fields(cls), values, strict=True)})


@dataclass(frozen=True, kw_only=True)
class MpcConfig(Settings, source=paper("section 2.4.2")):
    """The optimiser of the MPC, with a fixed number of iterations (paper, section 2.4)."""

    horizon: Annotated[int, at_least(2), STEPS, paper("section 2.4")] = 25
    """H: number of control periods that the optimiser predicts; about one shedding cycle."""
    iterations: AtLeastOne[int] = 5
    """Number of Adam iterations in each control step."""
    learning_rate: Positive[float] = 1e-3
    """Learning rate of the Adam iterations."""
    epsilon: Annotated[Positive[float], ours("from Kingma and Ba; the paper gives no value")] = 1e-8
    """Constant that Adam adds to the root of the gradient's second moment. With a constant far below the gradient's
    magnitude, the first step equals the learning rate. With a constant far above this magnitude, the first step is the
    gradient times learning rate / `mpc.epsilon`."""
    drag_reference: Annotated[Finite[float], paper("section 2.4.1")] = 1.051
    """C_d,ref: mean drag coefficient without control. This constant shifts the cost, but changes no plan."""
    weights: CostWeights = field(default_factory=CostWeights)
