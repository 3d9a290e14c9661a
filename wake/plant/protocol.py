"""The protocols of a plant (a flow around a body), and the clock that stillwake's solver and OpenFOAM share."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from contract.arrays import Array
from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.errors import PlantError
from contract.sensor_layout import SensorLayout
from wake.plant.drive import Wind
from wake.plant.sample import Sample
from wake.solver.grid import Grid


class Plant(Protocol):
    """The part of a plant's interface that the closed loop uses."""

    def sample(self) -> Sample:
        """Return the present measurements."""

    def advance_to(self, substep: int, action: float | None = None) -> None:
        """Advance within the control period to `substep`. If given, the jets reach `action` at the period's end."""


class LoopPlant(Plant, Protocol):
    """The part of a plant's interface that a run without pictures uses."""

    @property
    def layout(self) -> SensorLayout:
        """Layout of the sensors in a sample's Cp."""

    @property
    def description(self) -> str:
        """Description of solver, mesh and time step."""


class LivePlant(LoopPlant, Protocol):
    """The part of a plant's interface that pictures, and a run with pictures, use."""

    @property
    def grid(self) -> Grid: ...
    @property
    def config(self) -> FlowConfig: ...
    @property
    def body(self) -> BodyConfig: ...
    @property
    def t(self) -> float:
        """Time in t_c."""

    def vorticity(self) -> Array:
        """Return the vorticity in the grid's inner corners, (nx - 1, ny - 1); units U_inf / W."""

    def pressure(self) -> Array | None:
        """Return Cp in the grid's cells, (nx, ny); None if the plant has the pressure on the walls only."""


@runtime_checkable
class Disturbable(Plant, Protocol):
    """A plant whose viscosity and wind can change during a run."""

    config: FlowConfig
    wind: Wind | None

    @property
    def t(self) -> float:
        """Time in t_c."""

    def set_reynolds(self, reynolds: float) -> None:
        """Set the viscosity for another Reynolds number; the flow continues from its present state."""


@runtime_checkable
class Drivable(Disturbable, Protocol):
    """A plant whose free-stream speed can change."""

    def scale(self, ratio: float) -> None:
        """Scale the flow to a free stream of `ratio` times the present speed."""

    def state(self) -> Any:
        """Return the present state for a later `reset`."""

    def reset(self, state: Any) -> Sample:
        """Continue from a state."""


class SteppedPlant(Plant):
    """A plant that takes `config.substeps` time steps in a control period. This class has the plant's clock and checks
    the commands; a subclass defines `advance_to` and `sample`."""

    config: FlowConfig
    _substep: int
    _action: float

    @property
    def dt(self) -> float:
        """Time step in t_c."""
        return self.config.control_period / self.config.substeps

    @property
    def t(self) -> float:
        """Time in t_c."""
        return self._substep * self.dt

    @property
    def substeps_into_period(self) -> int:
        return self._substep % self.config.substeps

    def advance(self, action: float) -> Sample:
        """Ramp to `action` over the rest of the period and return the next sample. Raises as `advance_to` does."""
        self.advance_to(self.config.substeps, action)
        return self.sample()

    def _ramp(self, substep: int, action: float | None) -> tuple[int, float, float]:
        """Check the arguments of `advance_to`. Return the number of time steps, the flow rate that the ramp has reached
        after these steps, and the flow rate in force after them: the same, but exactly `action` at a period's end."""
        into, last = self.substeps_into_period, self.config.substeps
        if not into < substep <= last:
            raise PlantError(f"cannot advance to substep {substep} of {last} from substep {into}")
        target = self._action if action is None else self._checked(action)
        reached = self._action + (target - self._action) * (substep - into) / (last - into)
        return substep - into, reached, target if substep == last else reached

    def _checked(self, action: float) -> float:
        limit = self.config.action_limit
        if not np.isfinite(action) or abs(action) > limit * (1.0 + 1e-12):
            raise PlantError(f"action {action}: must be finite and within +-{limit}")
        return float(action)
