"""From fluid at rest around the truck to an established wake: how the shipped start was made."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

# An impulsive start is stiff: (dt, steps) until the first transients have left the leading edge.
_RAMP: Final = ((1e-4, 200), (1e-3, 200), (2e-3, 1000), (4e-3, 500))
_KICK_STEPS: Final = 50
_KICK_AMPLITUDE: Final = 2.0 / 3.0


def start_from_rest(wake: TruckWake) -> None:
    """Put the plant into uniform flow and let the first transients leave the leading edge; its clock stands at zero."""
    wake.reset(State(flat=wake.solver.start().flat, substep=0, action=0.0))
    for dt, steps in _RAMP:
        wake.solver.run(wake.flow, dt=dt, steps=steps, action_from=0.0, action_to=0.0)


def develop(
    wake: TruckWake, duration: float = 200.0, progress: Callable[[float, float], None] = lambda t, total: None
) -> State:
    """Start the flow, break its symmetry with two periods of the jets, and let it settle without control. Returns the
    state with its clock set back to zero and no action.

    Args:
        wake: the plant; left in the returned state.
        duration: time after the ramp, in t_c. The wake of this truck needs 60 to 100 t_c to become periodic.
        progress: called with (time, duration) after every control period.
    """
    start_from_rest(wake)
    flow = wake.config
    for k in range(round(duration / flow.control_period)):
        kick = _KICK_AMPLITUDE * np.sin(2.0 * np.pi * 0.2 * k * flow.control_period) if k < _KICK_STEPS else 0.0
        sample = wake.advance(flow.action_limit * float(kick))
        progress(sample.t, duration)
    state = replace(wake.state(), substep=0, action=0.0)
    wake.reset(state)
    return state
