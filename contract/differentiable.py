"""The interface of a differentiable plant, for training a controller with gradients through the flow."""

from dataclasses import dataclass
from typing import Protocol

from contract.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """The values of a sample that training reads, made dimensionless with the present speed. `Cp` (2 p,) has p mirrored
    pairs of sensors, pair by pair. `Uy` is the transverse velocity at the wake probe. The argument of `back` has the
    derivatives of a scalar with respect to these values."""

    Cp: Array
    Cd: float
    Cl: float
    Uy: float

    @property
    def differences(self) -> Array:
        """Differences of Cp between the two sensors of each of the p mirrored pairs, (p,)."""
        return self.Cp[::2] - self.Cp[1::2]


@dataclass(frozen=True, kw_only=True, eq=False)
class FlowState:
    """The flow's state in one vector, and the jets' action, both made dimensionless with the design speed."""

    flat: Array
    action: float = 0.0


class DifferentiableFlow(Protocol):
    """A plant that records its steps on a tape (`wake.truck.tape.Tape`) for reverse-mode differentiation."""

    def begin(self, state: FlowState, speeds: Array) -> Seen:
        """Start a run of n periods from a state, with an empty tape. `speeds` (n + 1,) has the ratios to the design
        speed at the start and at the sample of each period; between samples the speed is linear in time."""

    def advance(self, action: float) -> Seen:
        """Advance by a control period, in which the jets move to `action`, and record the period on the tape. Raises
        PlantError if the flow diverged, or if the run is too long for the tape's memory."""

    def back(self, weights: Seen) -> float:
        """Go back by a period, and return the derivative of a scalar with respect to this period's action. `weights`
        has the scalar's derivatives with respect to this period's sample. The first call is for the last period."""

    def state(self) -> FlowState:
        """Return the flow's present state, which `begin` accepts."""

    def at_rest(self, state: FlowState, speed: float) -> tuple[float, float] | None:
        """Return two mean values of the wake without jets, in Cp: the base pressure, and the magnitude of the
        differences between mirrored sensors. Return None if no sensor is on the base. `speed` is constant, as a ratio
        to the design speed. `state` is a developed wake at the design speed. Raises PlantError if the flow diverged."""
