"""The interface of a differentiable plant for training a controller through the flow."""

from dataclasses import dataclass
from typing import Protocol

from contract.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """The values of a sample that a training reads. As an argument of `back`, a scalar's gradient for each value.

    All are in units of the present speed.

    Attributes:
        Cp: (2 p,) at the sensors, in pairs of mirror images.
        Cd, Cl: drag and lift coefficients of the body.
        Uy: transverse velocity at the wake probe, in the present speed.
    """

    Cp: Array
    Cd: float
    Cl: float
    Uy: float

    @property
    def differences(self) -> Array:
        """Differences (p,) of the mirrored pairs."""
        return self.Cp[::2] - self.Cp[1::2]


@dataclass(frozen=True, kw_only=True, eq=False)
class FlowState:
    """A flow at the beginning of a control period: its state in one vector, and the action in force.

    State and actions are in units of the design speed, independent of the present speed.
    """

    flat: Array
    action: float = 0.0


class DifferentiableFlow(Protocol):
    """A plant that records its steps on a tape (`wake.truck.tape.Tape`) and differentiates them backwards."""

    def begin(self, state: FlowState, speeds: Array) -> Seen:
        """Continue from a state with an empty tape.

        Args:
            speeds: (n + 1,) ratios to the design speed at the n periods' samples and before them; linear in between.
        """
        ...

    def advance(self, action: float) -> Seen:
        """Advance by a control period, at the end of which the action is in force, and record the period on the tape.
        Raises PlantError if the flow diverged, or the window is too long for the tape's memory."""
        ...

    def back(self, weights: Seen) -> float:
        """Go back a period. Return the gradient of this and later samples with respect to the period's action."""
        ...

    def state(self) -> FlowState:
        """Return the present state of the flow, for a later `begin`."""
        ...

    def at_rest(self, state: FlowState, speed: float) -> tuple[float, float] | None:
        """Return the mean base pressure and the mean magnitude of the differences, in Cp, of the wake without jets;
        None if no sensor is on the base. Raises PlantError if the flow diverged.

        Args:
            state: a developed wake at the design speed.
            speed: constant, in units of the design speed.
        """
        ...
