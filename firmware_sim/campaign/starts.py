"""Where runs begin: the developed wake in several phases of its shedding cycle, so that no figure hangs on one."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from contract.config.body import TRUCK_BODY
from contract.config.tree import Config
from contract.errors import PlantError
from firmware_sim.campaign.folder import CampaignFolder
from wake.truck.develop import develop
from wake.truck.state import State, check_body, check_reynolds, developed_state, load_state, save_state
from wake.truck.truck_wake import TruckWake


def phases_apart(phases: int, config: Config) -> list[int]:
    """Control periods from the developed wake to each phase: equal parts of a shedding cycle of the body's wake."""
    cycle = 1.0 / config.forcing.base_frequency
    return [round(number * cycle / phases / config.flow.control_period) for number in range(phases)]


def starting_states(
    folder: CampaignFolder,
    config: Config,
    phases: int,
    scenario: str = "",
    progress: Callable[[float, float], None] = lambda t, total: None,
) -> tuple[State, ...]:
    """The states of all phases, their clocks at zero and the jets shut: those kept in the folder, or made now, which
    takes minutes for another body than the truck. Raises PlantError if there is no developed wake for the settings.

    Args:
        scenario: whose plant it is, if it is not that of all.
        progress: called with (time, total) in t_c while another body's wake develops.
    """
    kept = [_kept(folder.start(number, scenario), config) for number in range(phases)]
    whole = [state for state in kept if state is not None]
    if len(whole) == phases:
        return tuple(whole)
    return _advanced(config, phases_apart(phases, config), progress)


def keep_states(folder: CampaignFolder, states: Sequence[State], scenario: str = "") -> None:
    """Write the states of all phases where `starting_states` finds them."""
    for number, state in enumerate(states):
        save_state(folder.start(number, scenario), state)


def digest_of(state: State) -> str:
    """Hash of the flow, in hex."""
    return hashlib.sha256(state.flat.tobytes()).hexdigest()


def _kept(file: Path, config: Config) -> State | None:
    """A state that is there and of this plant: a scenario's may have been of another body before."""
    try:
        state = load_state(file)
        if state.origin is not None:
            check_body(state.origin, config.body)
            check_reynolds(state.origin, config.flow.reynolds)
    except PlantError:
        return None
    return state


def _advanced(config: Config, periods: Sequence[int], progress: Callable[[float, float], None]) -> tuple[State, ...]:
    wake = TruckWake(config.flow, body=config.body)
    if config.body == TRUCK_BODY:
        wake.reset(replace(developed_state(), substep=0, action=0.0))
    else:
        develop(wake, progress=progress)
    states, done = [], 0
    for wanted in periods:
        for _ in range(wanted - done):
            wake.advance(0.0)
        done = wanted
        states.append(replace(wake.state(), substep=0, action=0.0))
    return tuple(states)
