"""The wake that a refinement differentiates, built from the refinement's settings."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from contract.config.body import TRUCK_BODY, layout_of
from contract.config.tree import Config
from contract.differentiable import FlowState
from firmware_sim.campaign.folder import phases_apart
from wake.solver.grid import box_grid
from wake.truck.develop import SETTLE_TIME, develop, moved
from wake.truck.state import check_origin, developed_state, load_state
from wake.truck.tape import DifferentiableWake
from wake.truck.truck_wake import TruckWake


def differentiable_wake(
    config: Config, sensors: Sequence[str], start: Path | None, progress: Callable[[float, float], None]
) -> tuple[DifferentiableWake, list[FlowState]]:
    """Return the plant that a refinement simulates, on the refinement's mesh, and developed wakes in different phases,
    from which its parallel simulations start (`refine.streams`). `start` is a file with a developed wake on the default
    mesh; None means the truck's shipped wake or, for another body, a wake that is started from rest. `progress` is
    called with the simulated time and the duration, both in t_c, while the wake settles on the refinement's mesh.
    Raises PlantError if the wake in `start` has another body, Reynolds number or mesh, or if the flow diverges."""
    wake = wake_of(config, sensors)
    plant = wake.plant
    _develop(plant, start, progress)
    starts = list[FlowState]()
    reached = 0
    for apart in phases_apart(config.refine.streams, config):
        for _ in range(apart - reached):
            plant.advance(0.0)
        reached = apart
        starts.append(wake.state())
    return wake, starts


def _develop(plant: TruckWake, start: Path | None, progress: Callable[[float, float], None]) -> None:
    if start is None and plant.body != TRUCK_BODY:
        develop(plant, progress=progress)
        return
    state, source = developed_state() if start is None else load_state(start), box_grid(plant.body.length)
    check_origin(state.origin, plant.body, plant.config.reynolds, source.shape)
    moved(state, source, plant, SETTLE_TIME, progress)


def wake_of(config: Config, sensors: Sequence[str]) -> DifferentiableWake:
    """Return the plant that a refinement simulates, on the refinement's mesh, with the fluid at rest."""
    precision = np.float32 if config.refine.single_precision else np.float64
    plant = TruckWake(mesh_of(config).flow, body=config.body, precision=precision)
    return DifferentiableWake(plant, layout_of(config.body).indices(sensors))


def mesh_of(config: Config) -> Config:
    """Return the settings with the mesh on which the refinement simulates the flow."""
    flow = replace(config.flow, refinement=config.refine.refinement, substeps=config.refine.substeps)
    return replace(config, flow=flow)
