"""The functions that open the plant of a closed loop by the plant's name."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal

from contract.config.tree import Config
from contract.errors import PlantError
from wake.plant.protocol import LivePlant
from wake.solver.grid import box_grid
from wake.truck.develop import SETTLE_TIME, FlowProgress, moved
from wake.truck.state import State, check_origin, developed_state, develops, load_state, start_name
from wake.truck.truck_wake import TruckWake

PlantName = Literal["wake", "openfoam"]


@contextmanager
def open_plant(
    name: PlantName,
    output: Path,
    config: Config,
    duration: float = 0.0,
    progress: FlowProgress = lambda t, total: None,
    *,
    start: Path | None = None,
) -> Iterator[LivePlant]:
    """Open a developed wake at t = 0; OpenFOAM stops when the `with` block ends. Raises PlantError if the start does
    not match the settings, or OpenFOAM is requested for a body other than the truck, is not installed, or fails.

    Args:
        name: "wake" for stillwake's solver, or "openfoam".
        output: run folder, in which OpenFOAM's case runs and OpenFOAM's developed start is stored.
        duration: duration of the run in t_c; OpenFOAM needs it in advance.
        progress: called with (time, total) while OpenFOAM computes a start state or a state settles on another grid.
        start: file of the state from which stillwake's solver starts; the clock is set to zero and the jets are shut.
            None means the shipped start, interpolated to the grid of `flow.refinement`.
    """
    if name == "wake":
        yield own_wake(config, progress, start=start)
        return
    if start is not None:
        raise PlantError(f"state {start}: OpenFOAM develops its own start; only stillwake's solver accepts a file")
    from wake.openfoam.plant import OpenFoamWake
    from wake.openfoam.state import developed, require_truck

    require_truck(config.body)
    if config.flow.refinement != 1.0:
        raise PlantError(
            f"flow.refinement = {config.flow.refinement:g}: refines only the grid of stillwake's solver; "
            "set openfoam.refinement for OpenFOAM's mesh"
        )
    folder = output / "openfoam"
    begin = developed(folder, config.flow, config.openfoam, progress)
    refinement = config.openfoam.refinement
    with OpenFoamWake(folder / "coupled", begin, config.flow, refinement, duration=duration) as foam:
        yield foam


def own_wake(config: Config, progress: FlowProgress = lambda t, total: None, *, start: Path | None = None) -> TruckWake:
    """Return the developed wake of stillwake's solver at t = 0. Arguments and errors are as for `open_plant`."""
    state = _start(start, config)
    wake = TruckWake(config.flow, body=config.body)
    if start is None and state.origin is not None and state.origin.shape != wake.grid.shape:
        moved(state, box_grid(config.body.length), wake, SETTLE_TIME, progress)
    else:
        wake.reset(state)
    return wake


def _start(path: Path | None, config: Config) -> State:
    state = developed_state() if path is None else load_state(path)
    check_origin(state.origin, config.body)
    reynolds = config.flow.reynolds
    if state.origin is not None and state.origin.reynolds != reynolds:
        name = "the shipped start" if path is None else f"state {path}"
        raise PlantError(
            f"flow.reynolds = {reynolds:g}: {name} has {state.origin.reynolds:g}; `{develops(reynolds)}` makes a "
            f"state for `--state {start_name(reynolds)} --set flow.reynolds={reynolds:g}`"
        )
    return replace(state, substep=0, action=0.0)
