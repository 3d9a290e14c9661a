"""Initial states of runs: the wake at several shedding phases, so that no result depends on a single phase."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from contract.config.body import TRUCK_BODY
from contract.config.tree import Config
from contract.errors import PlantError
from firmware_sim.campaign.folder import CampaignFolder
from wake.truck.develop import develop
from wake.truck.state import State, check_origin, developed_state, load_state, save_state
from wake.truck.truck_wake import TruckWake


def phases_apart(phases: int, config: Config) -> list[int]:
    """Return the numbers of control periods from the developed wake to the starting phases, spread over a cycle."""
    cycle = 1.0 / config.forcing.base_frequency
    return [round(number * cycle / phases / config.flow.control_period) for number in range(phases)]


def starting_states(
    folder: CampaignFolder,
    config: Config,
    phases: int,
    scenario: str = "",
    progress: Callable[[float, float], None] = lambda t, total: None,
) -> tuple[State, ...]:
    """Return the flow states of all starting phases, at time zero with the jets shut. They are read from the folder or
    computed. For a body other than the truck this takes minutes, and `progress` is called with (time, total time) in
    t_c. `scenario` is empty for the common plant of the scenarios that have no plant of their own. Raises PlantError if
    there is no developed wake for the settings."""
    kept = [_kept(folder.start(number, scenario), config) for number in range(phases)]
    whole = [state for state in kept if state is not None]
    if len(whole) == phases:
        return tuple(whole)
    wake = TruckWake(config.flow, body=config.body)
    if config.body == TRUCK_BODY:
        wake.reset(replace(developed_state(), substep=0, action=0.0))
    else:
        develop(wake, progress=progress)
    states, done = [], 0
    for wanted in phases_apart(phases, config):
        for _ in range(wanted - done):
            wake.advance(0.0)
        done = wanted
        states.append(replace(wake.state(), substep=0, action=0.0))
    return tuple(states)


def keep_states(folder: CampaignFolder, states: Sequence[State], scenario: str = "") -> None:
    """Write the states of all starting phases to the files that `starting_states` reads."""
    for number, state in enumerate(states):
        save_state(folder.start(number, scenario), state)


def digest_of(state: State) -> str:
    return hashlib.sha256(state.flat.tobytes()).hexdigest()


def _kept(file: Path, config: Config) -> State | None:
    """Return the state in the file; None if the file is missing or belongs to an earlier body of the scenario."""
    try:
        state = load_state(file)
        check_origin(state.origin, config.body, config.flow.reynolds)
    except PlantError:
        return None
    return state
