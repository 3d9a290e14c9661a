"""What the refinement needs of a differentiable plant: `train` knows none, the command line hands one over."""

from dataclasses import dataclass
from typing import Protocol

from contract.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What the refinement reads of a sample; with numbers of the same shapes, what a scalar gains by each of them.

    Attributes:
        differences: (p,) of the pairs of sensors, in Cp.
        Cd, Cl: of the body.
        Uy: transverse velocity at the wake probe, in U_inf.
    """

    differences: Array
    Cd: float
    Cl: float
    Uy: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FlowState:
    """A flow at the beginning of a control period: its numbers in one vector, and the action in force."""

    flat: Array
    action: float = 0.0


class DifferentiableFlow(Protocol):
    """A plant with a tape (`wake.truck.tape.Tape`), by the few values above."""

    def begin(self, state: FlowState) -> Seen:
        """Go on from there with an empty tape."""
        ...

    def advance(self, action: float) -> Seen:
        """A control period, at whose end the action is in force; kept for the way back.

        Raises:
            PlantError: the flow diverged, or the window is too long for the tape's memory.
        """
        ...

    def back(self, weights: Seen) -> float:
        """Go back by a period: the sensitivity of its sample, and of later ones, to the action commanded in it."""
        ...

    def state(self) -> FlowState:
        """Where the flow is, for a later `begin`."""
        ...
