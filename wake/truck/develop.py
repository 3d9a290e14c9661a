"""The computation of a developed wake, from fluid at rest or from another grid, and of the steady wake. From rest, as
for the shipped start, a wake takes 100 t_c to develop, because the shedding has to grow first.

The steady wake is the symmetric flow that results if symmetry suppresses shedding. A symmetric flow remains symmetric
except for rounding errors, which the shedding instability amplifies. After every control period, only the symmetric
part of the flow is kept. This removes these errors, and the flow settles. The drag of the steady wake is therefore the
part of the drag that shedding does not cause.
"""

from collections.abc import Callable
from dataclasses import replace
from math import ceil
from typing import Final, get_args

import numpy as np
from scipy.interpolate import interpn

from contract.arrays import Array
from contract.errors import PlantError
from wake.plant.sample import Sample
from wake.solver.grid import Component, Flow, Grid
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

FlowProgress = Callable[[float, float], None]
"""A function that is called with (time, total) after every control period."""
# After an impulsive start, the time step must be small until the first transients have left the leading edge. A pair is
# (dt, number of steps). A plant whose own time step is shorter takes more steps for the same time.
_RAMP: Final = ((1e-4, 200), (1e-3, 200), (2e-3, 1000), (4e-3, 500))


def start_from_rest(wake: TruckWake) -> None:
    """Set the plant to uniform flow, run it until the first transients leave the leading edge, and zero its clock."""
    wake.reset(State(flat=wake.solver.start().flat, substep=0, action=0.0))
    for longest, steps in _RAMP:
        dt = min(longest, wake.dt)
        wake.solver.run(wake.flow, dt=dt, steps=ceil(steps * (longest / dt)), action_from=0.0, action_to=0.0)


def develop(wake: TruckWake, duration: float = 200.0, progress: FlowProgress = lambda t, total: None) -> State:
    """Start the flow, break its symmetry with two periods of a sinusoidal jet action, and let it settle without control
    for `duration` t_c; the wake of the truck needs 60 to 100 t_c to become periodic. Returns the state with its clock
    set to zero and with shut jets; the plant is in this state, too."""
    start_from_rest(wake)
    flow = wake.config
    for k in range(round(duration / flow.control_period)):
        kick = 2.0 / 3.0 * np.sin(2.0 * np.pi * 0.2 * k * flow.control_period) if k < 50 else 0.0
        sample = wake.advance(flow.action_limit * float(kick))
        progress(sample.t, duration)
    state = replace(wake.state(), substep=0, action=0.0)
    wake.reset(state)
    return state


SETTLE_TIME: Final = 60.0
"""Time without jets, in t_c, after which an interpolated wake agrees with a wake that developed from rest on the final
grid (refinement 0.4 and 0.5). Mean drag and lift amplitude then agree within 0.3 %. The difference of the mean lift,
which decays last, is then below 0.01."""


def interpolated(state: State, source: Grid, target: Grid) -> Flow:
    """Interpolate the flow of a state on `source` bilinearly to `target`; extrapolate it beyond the outermost points.
    The padding is zero. The next time step removes the divergence of the velocities."""
    found, result = Flow.of(state.flat, source.shape), Flow.zeros(target.shape)
    for name in get_args(Component):
        points = np.stack(np.meshgrid(*target.axes(name), indexing="ij"), axis=-1)
        result.unpadded(name)[:] = at_points(found, source, name, points)
    return result


def at_points(flow: Flow, grid: Grid, component: Component, points: Array) -> Array:
    """Interpolate a component of a flow bilinearly to points (..., 2); extrapolate it beyond the outermost values."""
    values = flow.unpadded(component)
    return np.asarray(interpn(grid.axes(component), values, points, bounds_error=False, fill_value=None))


def moved(
    state: State, source: Grid, wake: TruckWake, duration: float, progress: FlowProgress = lambda t, total: None
) -> State:
    """Interpolate a state on another grid, `source`, to the plant's grid, and let the flow settle without jets for
    `duration` t_c. The plant determines body and Reynolds number. Raises PlantError if the flow diverges. Returns the
    state with its clock at zero and with shut jets; the plant is in this state, too."""
    flow = Flow.of(interpolated(state, source, wake.grid).flat.astype(wake.solver.precision), wake.grid.shape)
    pressure = flow.p.copy()
    # A very short step fills padding and ghosts, and removes the divergence; its pressure is an impulse.
    wake.solver.run(flow, dt=1e-6, steps=1, action_from=0.0, action_to=0.0)
    flow.p[:] = pressure
    wake.reset(State(flat=flow.flat, substep=0, action=0.0))
    for _ in range(round(duration / wake.config.control_period)):
        progress(wake.advance(0.0).t, duration)
    settled = replace(wake.state(), substep=0, action=0.0)
    wake.reset(settled)
    return settled


TOLERANCE: Final = 1e-6
"""Rate of change below which a wake counts as steady, in U_inf / t_c for velocity and in 1 / t_c for drag. The forces
are then accurate to 1e-5, because these rates fall by a factor e in 23 t_c."""
_UNEVEN: Final = 1e-9
"""Largest difference in U_inf between a steady state and its mirror image; a settled state is symmetric bit for bit."""
_RATE: Final = 1e-2
"""Largest rate at which the velocities of a steady state may change, in U_inf / t_c. A settled state changes far more
slowly; the developed wake changes at a rate of about 1."""


def settle(
    wake: TruckWake, tolerance: float = TOLERANCE, longest: float = 600.0, progress: FlowProgress = lambda t, rate: None
) -> tuple[State, dict[str, float]]:
    """Run the symmetric flow from rest, with shut jets, until two rates of change are below `tolerance`: the largest
    |du/dt| or |dv/dt| in U_inf / t_c, and the rate of the drag of wall and slots in 1 / t_c. Raises PlantError
    if the flow is not steady after `longest` t_c. `progress` is called with the time and the larger rate after every
    control period.

    Returns the state with its clock set to zero (the plant is in this state, too), and the numbers for a results file:
    drag, mean Cp over the sensors on the base, `recirculation_length`, both rates over the last control period, and the
    duration of the settling from rest.
    """
    start_from_rest(wake)
    period = wake.config.control_period
    before, drag = wake.flow.velocities.copy(), _drag(wake.sample())
    while wake.t < longest:
        wake.advance(0.0)
        _keep_even_part(wake.flow)
        now = _drag(wake.sample())
        velocity_rate = float(np.abs(wake.flow.velocities - before).max()) / period
        drag_rate = abs(now - drag) / period
        before[:], drag = wake.flow.velocities, now
        progress(wake.t, max(velocity_rate, drag_rate))
        if max(velocity_rate, drag_rate) < tolerance:
            break
    else:
        raise PlantError(
            f"the symmetric wake is not steady after {longest:g} t_c: max |du/dt| = {velocity_rate:.2g} and "
            f"|dCd/dt| = {drag_rate:.2g} must be below {tolerance:g}"
        )
    time, state = wake.t, replace(wake.state(), substep=0, action=0.0)
    sample = wake.reset(state)
    return state, {
        "Cd": sample.Cd,
        "Cd_slot": sample.Cd_slot,
        "base_Cp": float(sample.Cp[wake.layout.base].mean()),
        "recirculation_length": recirculation_length(wake.grid, wake.flow),
        "velocity_rate": velocity_rate,
        "drag_rate": drag_rate,
        "time": time,
    }


def check_steady(wake: TruckWake, state: State) -> None:
    """Check that a state is the steady symmetric wake; the plant advances by one control period. Raises PlantError if
    the flow changes or is not its own mirror image, or if the action is not zero."""
    wake.reset(state)
    flow = wake.flow
    uneven = max(float(np.abs(flow.u - flow.u[:, ::-1]).max()), float(np.abs(flow.v + flow.v[:, ::-1]).max()))
    remedy = "`stillwake develop FILE --steady` computes the steady wake"
    if uneven > _UNEVEN or state.action != 0.0:
        raise PlantError(
            f"not the steady wake: velocities differ from their mirror image by up to {uneven:.2g}, with an action of "
            f"{state.action:g} in force: {remedy}"
        )
    before = flow.velocities.copy()
    wake.advance(0.0)
    rate = float(np.abs(flow.velocities - before).max()) / wake.config.control_period
    if rate > _RATE:
        raise PlantError(f"not the steady wake: max |du/dt| = {rate:.2g}, must be at most {_RATE:g}: {remedy}")


def recirculation_length(grid: Grid, flow: Flow) -> float:
    """Return the recirculation bubble's length in a steady or mean flow, in W: from the base to the last point on the
    axis y = 0 where u turns positive, or to the outlet if the flow there is reversed; 0 without reversed flow."""
    # The axis is a row of faces, so u is stored half a cell below and above the axis.
    above = grid.shape[1] // 2
    speed = flow.faces_u[grid.rear :, above - 1 : above + 1].mean(axis=1)
    x = grid.xf[grid.rear :] - grid.xf[grid.rear]
    upstream = np.flatnonzero(speed < 0.0)
    if len(upstream) == 0:
        return 0.0
    last = int(upstream[-1])
    if last == len(x) - 1:
        return float(x[-1])
    share = speed[last] / (speed[last] - speed[last + 1])
    return float(x[last] + share * (x[last + 1] - x[last]))


def _drag(sample: Sample) -> float:
    return sample.Cd + sample.Cd_slot


def _keep_even_part(flow: Flow) -> None:
    flow.u[:] = 0.5 * (flow.u + flow.u[:, ::-1])
    flow.v[:] = 0.5 * (flow.v - flow.v[:, ::-1])
    flow.p[:] = 0.5 * (flow.p + flow.p[:, ::-1])
