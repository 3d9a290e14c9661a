"""A plant that is differentiated along with its controller: what a training through the flow needs of it."""

from dataclasses import dataclass
from typing import Protocol

from contract.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """Values of a sample that a training reads; with numbers of the same shapes, what a scalar gains by each of them.

    All are in units of the present speed.

    Attributes:
        Cp: (2 p,) at the sensors, in pairs of mirror images.
        Cd, Cl: of the body.
        Uy: transverse velocity at the wake probe, in the present speed.
    """

    Cp: Array
    Cd: float
    Cl: float
    Uy: float

    @property
    def differences(self) -> Array:
        """(p,) of the pairs."""
        return self.Cp[::2] - self.Cp[1::2]


@dataclass(frozen=True, kw_only=True, eq=False)
class FlowState:
    """A flow at the beginning of a control period: its numbers in one vector, and the action in force.

    They and actions are in units of the design speed, whatever the present one is.
    """

    flat: Array
    action: float = 0.0


class DifferentiableFlow(Protocol):
    """A plant with a tape (`wake.truck.tape.Tape`), by the few values above."""

    def begin(self, state: FlowState, speeds: Array) -> Seen:
        """Go on from there with an empty tape.

        Args:
            speeds: (n + 1,) at the n periods' samples and before, as ratios to the design speed; linear in between.
        """
        ...

    def advance(self, action: float) -> Seen:
        """Go on by a control period, at whose end the action is in force, and keep it for the way back. Raises
        PlantError if the flow diverged, or the window is too long for the tape's memory."""
        ...

    def back(self, weights: Seen) -> float:
        """Go back by a period: the sensitivity of its sample, and of later ones, to the action commanded in it."""
        ...

    def state(self) -> FlowState:
        """Where the flow is, for a later `begin`."""
        ...

    def at_rest(self, state: FlowState, speed: float) -> tuple[float, float] | None:
        """Mean pressure on the base and mean magnitude of the differences, in Cp, of the wake without jets; None where
        none of the sensors is on the base. Raises PlantError if the flow diverged.

        Args:
            state: a developed wake of the design speed.
            speed: steady, in design speeds.
        """
        ...
