"""The computation of a developed wake, from fluid at rest or from a developed wake on another grid. A start from rest,
like the shipped one, takes 100 t_c, because the shedding has to grow first."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from contract.arrays import Array
from wake.solver.flow import Flow
from wake.solver.grid import Component, Grid
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

# After an impulsive start, the time step must be small until the first transients have left the leading edge. Each pair
# is (dt, number of steps).
_RAMP: Final = ((1e-4, 200), (1e-3, 200), (2e-3, 1000), (4e-3, 500))
_KICK_STEPS: Final = 50
_KICK_AMPLITUDE: Final = 2.0 / 3.0


def start_from_rest(wake: TruckWake) -> None:
    """Set the plant to uniform flow, run until the first transients have left the leading edge, and zero its clock."""
    wake.reset(State(flat=wake.solver.start().flat, substep=0, action=0.0))
    for dt, steps in _RAMP:
        wake.solver.run(wake.flow, dt=dt, steps=steps, action_from=0.0, action_to=0.0)


def develop(
    wake: TruckWake, duration: float = 200.0, progress: Callable[[float, float], None] = lambda t, total: None
) -> State:
    """Start the flow, break its symmetry with two periods of a sinusoidal jet action, and let it settle without
    control. Returns the state with its clock set to zero and with shut jets; the plant is in this state, too.

    Args:
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


SETTLE_TIME: Final = 60.0
"""Time without jets, in t_c, after which an interpolated wake agrees with a wake that developed from rest on the final
grid (refinement 0.4 and 0.5). Mean drag and lift amplitude then agree within 0.3 %. The difference of the mean lift,
which decays last, is then below 0.01."""

_COMPONENTS: Final[tuple[Component, ...]] = ("u", "v", "p")


def interpolated(state: State, source: Grid, target: Grid) -> Flow:
    """Interpolate the flow of a state on `source` bilinearly to `target`; extrapolate it beyond the outermost points.
    The padding is zero. The next time step removes the divergence of the velocities."""
    found, result = Flow.of(state.flat, source.shape), Flow.zeros(target.shape)
    for name in _COMPONENTS:
        at = np.stack(np.meshgrid(*target.axes(name), indexing="ij"), axis=-1)
        look_up = RegularGridInterpolator(source.axes(name), _values(found, name), bounds_error=False, fill_value=None)
        _values(result, name)[:] = look_up(at)
    return result


def moved(
    state: State,
    source: Grid,
    wake: TruckWake,
    duration: float,
    progress: Callable[[float, float], None] = lambda t, total: None,
) -> State:
    """Interpolate a state on another grid, `source`, to the plant's grid, and let the flow settle without jets for
    `duration` t_c. The plant determines body and Reynolds number. Raises PlantError if the flow diverges. Returns the
    state with its clock at zero and with shut jets; the plant is in this state, too. `progress` is called with (time,
    duration) after every control period."""
    flow = Flow.of(interpolated(state, source, wake.grid).flat.astype(wake.solver.precision), wake.grid.shape)
    pressure = flow.p.copy()
    # A very short step fills the padding and the ghosts, and removes the divergence. Its pressure is an impulse, so the
    # flow gets the interpolated pressure back.
    wake.solver.run(flow, dt=1e-6, steps=1, action_from=0.0, action_to=0.0)
    flow.p[:] = pressure
    wake.reset(State(flat=flow.flat, substep=0, action=0.0))
    for _ in range(round(duration / wake.config.control_period)):
        progress(wake.advance(0.0).t, duration)
    settled = replace(wake.state(), substep=0, action=0.0)
    wake.reset(settled)
    return settled


def _values(flow: Flow, name: Component) -> Array:
    """Return the component's unpadded values, a view."""
    return {"u": flow.faces_u, "v": flow.faces_v, "p": flow.cells_p}[name]
