"""The flows that a closed loop can run on."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, Protocol

from contract.config.tree import Config
from wake.pictures.drawing import Pictured
from wake.plant import Plant
from wake.truck.truck_wake import TruckWake, developed_state

PlantName = Literal["stillwake", "openfoam"]


class LivePlant(Plant, Pictured, Protocol):
    """What a run needs of a flow."""

    @property
    def description(self) -> str:
        """Solver, mesh and time step in a few words."""


@contextmanager
def open_plant(
    name: PlantName,
    output: Path,
    config: Config,
    duration: float = 0.0,
    progress: Callable[[float, float], None] = lambda t, total: None,
) -> Iterator[LivePlant]:
    """A developed wake at t = 0.

    Args:
        name: the own solver from its shipped start, or OpenFOAM.
        output: run folder; OpenFOAM's case lives in it while it runs, and its developed start stays there.
        config: clock and bounds.
        duration: how long the run will be, t_c; OpenFOAM wants to know.
        progress: called with (time, total) while OpenFOAM's start develops.

    Raises:
        PlantError: if OpenFOAM is asked for and not installed, or fails.
    """
    if name == "stillwake":
        wake = TruckWake(config.flow)
        wake.reset(developed_state())
        yield wake
        return
    from wake.openfoam.develop import developed
    from wake.openfoam.plant import OpenFoamWake

    folder = output / "openfoam"
    start = developed(folder, config.flow, config.openfoam, progress)
    refinement = config.openfoam.refinement
    with OpenFoamWake(folder / "coupled", start, config.flow, refinement, duration=duration) as foam:
        yield foam
