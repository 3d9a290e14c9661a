"""What others need of a flow around a body; the own solver and OpenFOAM both give it."""

from typing import Any, Protocol, runtime_checkable

from contract.arrays import Array
from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.sensor_layout import SensorLayout
from wake.plant.drive import Wind
from wake.plant.sample import Sample
from wake.solver.grid import Grid


class Plant(Protocol):
    """What the loop needs of a flow."""

    def sample(self) -> Sample:
        """Measure now."""

    def advance_to(self, substep: int, action: float | None = None) -> None:
        """Advance within the control period; with an action, ramp so as to reach it at the period's end."""


class LoopPlant(Plant, Protocol):
    """What a run without pictures needs of a flow."""

    @property
    def layout(self) -> SensorLayout:
        """Layout of the sensors in a sample's Cp."""

    @property
    def description(self) -> str:
        """Solver, mesh and time step in a few words."""


class Drawable(Protocol):
    """What a picture needs of a flow."""

    @property
    def grid(self) -> Grid: ...
    @property
    def config(self) -> FlowConfig: ...
    @property
    def body(self) -> BodyConfig: ...
    @property
    def layout(self) -> SensorLayout:
        """Layout of the sensors in a sample's Cp."""

    @property
    def t(self) -> float:
        """Time in t_c."""

    def sample(self) -> Sample:
        """Measure now."""

    def vorticity(self) -> Array:
        """The vorticity in the grid's inner corners, (nx - 1, ny - 1); units U_inf / W."""

    def pressure(self) -> Array | None:
        """Cp in the grid's cells, (nx, ny); None if the plant gives it on the walls only."""


class LivePlant(LoopPlant, Drawable, Protocol):
    """What a run needs of a flow."""


@runtime_checkable
class Disturbable(Plant, Protocol):
    """A flow that can be made another one while it runs; of these here the own solver."""

    config: FlowConfig
    wind: Wind | None

    @property
    def t(self) -> float:
        """Time in t_c."""

    def set_reynolds(self, reynolds: float) -> None:
        """Go on with another viscosity."""


@runtime_checkable
class Drivable(Disturbable, Protocol):
    """A flow whose stream can be given another speed; of these here the own solver."""

    def scale(self, ratio: float) -> None:
        """Make the flow that of a stream so many times as fast."""

    def state(self) -> Any:
        """What `reset` takes."""

    def reset(self, state: Any) -> Sample:
        """Go on from there, to the bit."""
