"""Where tuning runs begin: phases of the shedding cycle on the mesh of the settings, kept in a folder."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from contract.config.tree import Config
from contract.errors import PlantError
from firmware_sim.bench.spans import SHEDDING_TIME
from wake.plants import own_wake
from wake.truck.state import State, load_state, save_state
from wake.truck.truck_wake import TruckWake


def phases_between(phases: int, control_period: float) -> list[int]:
    """Control periods to phases that lie amid those of `phases_apart`: half a part of a shedding cycle later."""
    return [round((number + 0.5) * SHEDDING_TIME / phases / control_period) for number in range(phases)]


def phases_of(config: Config, starts: Sequence[State]) -> Callable[[int], TruckWake]:
    """One plant that is put at the start of a phase, again and again."""
    wake = TruckWake(config.flow, body=config.body)

    def at(phase: int) -> TruckWake:
        wake.reset(starts[phase])
        return wake

    return at


def starts_at(
    folder: Path, config: Config, periods: Sequence[int], progress: Callable[[float, float], None]
) -> list[State]:
    """The flow so many control periods after the developed wake, jets shut and clock at zero.

    Args:
        folder: where they are kept; made if need be.
        config: with the mesh. On another one than the shipped start's the wake first settles.
        periods: in rising order.
        progress: called with (time, total) in t_c while the wake settles.

    Raises:
        PlantError: if there is no developed wake for the settings.
    """
    files = [folder / f"{number}.npz" for number in periods]
    try:
        return [load_state(file) for file in files]
    except PlantError:
        pass
    wake = own_wake(config, progress)
    states, done = [], 0
    for wanted in periods:
        for _ in range(wanted - done):
            wake.advance(0.0)
        done = wanted
        states.append(replace(wake.state(), substep=0, action=0.0))
    for file, state in zip(files, states, strict=True):
        save_state(file, state)
    return states
