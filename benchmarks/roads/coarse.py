"""A coarser mesh for what needs many runs of the flow: the cheapest on which the release does as on its own.

On meshes coarser still it fails (results/live_speed.json), so a comparison there would mean nothing.
"""

from dataclasses import replace
from pathlib import Path
from typing import Final

from contract.config.tree import Config
from firmware_sim.campaign.starts import phases_apart
from wake.solver.grid import box_grid
from wake.truck.regrid import SETTLE_TIME, moved
from wake.truck.state import State, developed_state, load_state, save_state
from wake.truck.truck_wake import TruckWake

REFINEMENT: Final = 0.75
SUBSTEPS: Final = 15


def coarse(config: Config) -> Config:
    """The vehicle with that mesh."""
    return replace(config, flow=replace(config.flow, refinement=REFINEMENT, substeps=SUBSTEPS))


def coarse_start(folder: Path, config: Config) -> State:
    """The developed wake on it, without jets; kept in the folder.

    Args:
        config: of `coarse`.
    """
    path = folder / f"developed_{REFINEMENT:g}_{SUBSTEPS}.npz"
    if not path.exists():
        wake = TruckWake(config.flow, body=config.body)
        save_state(path, moved(developed_state(), box_grid(config.body.length), wake, SETTLE_TIME))
    return load_state(path)


def coarse_starts(folder: Path, config: Config, phases: int) -> tuple[State, ...]:
    """That wake in so many phases of its shedding cycle, clocks at zero.

    Args:
        folder, config: as `coarse_start`.
    """
    states, done = [coarse_start(folder, config)], 0
    if phases > 1:
        wake = TruckWake(config.flow, body=config.body)
        wake.reset(states[0])
        for wanted in phases_apart(phases, config.flow.control_period)[1:]:
            for _ in range(wanted - done):
                wake.advance(0.0)
            done = wanted
            states.append(replace(wake.state(), substep=0, action=0.0))
    return tuple(states)
