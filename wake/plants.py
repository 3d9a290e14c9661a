"""Opening the flow that a closed loop runs on, by name."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from contract.config.tree import Config
from wake.plant import LivePlant
from wake.truck.state import developed_state
from wake.truck.truck_wake import TruckWake

PlantName = Literal["stillwake", "openfoam"]


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
        duration: how long the run will be, t_c; OpenFOAM needs it in advance.
        progress: called with (time, total) while OpenFOAM's start develops.

    Raises:
        PlantError: if OpenFOAM is asked for another body than the truck, is not installed, or fails.
    """
    if name == "stillwake":
        wake = TruckWake(config.flow, body=config.body)
        wake.reset(developed_state())
        yield wake
        return
    from wake.openfoam.develop import developed, require_truck
    from wake.openfoam.plant import OpenFoamWake

    require_truck(config.body)
    folder = output / "openfoam"
    start = developed(folder, config.flow, config.openfoam, progress)
    refinement = config.openfoam.refinement
    with OpenFoamWake(folder / "coupled", start, config.flow, refinement, duration=duration) as foam:
        yield foam
