"""The time integration of the incompressible Navier-Stokes equations: three Runge-Kutta stages and one pressure
projection per step.

The stages have Williamson's low-storage coefficients and use the pressure gradient at the step's start. The projection
adds the change of the gradient. The velocity is of second order in time. The boundary conditions are uniform inflow,
slip sides, p = 0 and zero normal gradient at the outlet, no slip on the body, and prescribed flow through the slots.
The velocity at the outlet solves the momentum equation, as in the interior, with a mirrored cell beyond the outlet. If
this velocity were copied from upstream, a vortex that leaves the domain would disturb the pressure everywhere. Pressure
here is kinematic, p / (rho U_inf^2); Cp is twice this pressure.

A varying wind is given in the frame of the body, as for a vehicle whose speed through the air varies. A change of the
wind changes the inflow, and accelerates the whole flow uniformly. So the far pressure does not change.

The convective number of a cell is dt (|u| / dx + |v| / dy). The viscous number is 4 nu dt (1 / dx^2 + 1 / dy^2). A
three-stage Runge-Kutta scheme of order 3 is stable up to a convective number of 1.73 without viscosity (2.0 to 2.4 with
the viscosity of this flow), and up to a viscous number of 2.51. Runs of the uncontrolled truck are stable with a
convective number of 2.0 at the front corners and diverge at 2.3. Next to the jets, flow is fast in few cells and for a
short time. Runs of 100 periods with full reversals of the jets are stable with 4.0 next to the jets and diverge at 4.3.
"""

from collections.abc import Callable
from math import ceil
from typing import Final

import numpy as np

from contract.arrays import Array, Mask, Precision
from contract.errors import PlantError
from contract.runtime.copies import CopiedWhole
from wake.solver import kernels, poisson
from wake.solver.boundary import Boundary
from wake.solver.grid import Flow, Grid

# Williamson's RK3 computes `q = A * q + dt * rate`, then `velocity += B * q`. STAGE_END has the times at which the
# stages end, as fractions of the step.
A = np.array([0.0, -5.0 / 9.0, -153.0 / 128.0])
B = np.array([1.0 / 3.0, 15.0 / 16.0, 8.0 / 15.0])
STAGE_END = (1.0 / 3.0, 3.0 / 4.0, 1.0)
_STEADY = np.zeros(len(STAGE_END))


class FlowSolver(CopiedWhole):
    """A time integration of a `Flow` on one grid around one body. `viscosity` is 1 / Re. `slot_profile` (ny,) is the
    velocity on the faces at `grid.rear` per unit action; None if there are no jets. `inflow_u` (ny,) and `inflow_v` (ny
    + 1,) are the velocity at the inlet. `precision` is the precision of the flows; the grid and the projection's
    factors are computed in double precision first."""

    def __init__(
        self,
        grid: Grid,
        boundary: Boundary,
        viscosity: float,
        slot_profile: Array | None = None,
        inflow_u: Array | None = None,
        inflow_v: Array | None = None,
        precision: Precision = np.float64,
    ) -> None:
        ny = grid.shape[1]
        self.grid, self.boundary, self.precision = grid, boundary, precision
        self.poisson = poisson.PoissonSolver(grid, boundary.fluid, precision)
        self.slot_profile = np.zeros(ny) if slot_profile is None else slot_profile
        # The projection has no mirrored cells, so it uses the grid's own spacings.
        self.between = grid.dxc.astype(precision)
        dxc = grid.dxc.copy()
        dxc[0], dxc[-1] = grid.dx[0], grid.dx[-1]
        spacings = (np.append(grid.dx, grid.dx[-1]), dxc, grid.dy, grid.dyc)
        ghosts = (boundary.u_ghosts, boundary.v_ghosts)
        inflow_u = np.ones(ny) if inflow_u is None else inflow_u
        inflow_v = np.zeros(ny + 1) if inflow_v is None else inflow_v
        self.domain = kernels.Domain(
            viscosity=viscosity,
            spacing=kernels.Spacing(*(each.astype(precision) for each in spacings)),
            runs=kernels.Pair(boundary.u_runs, boundary.v_runs),
            walls=kernels.Pair(*(each._replace(weight=each.weight.astype(precision)) for each in ghosts)),
            inflow=kernels.Pair(inflow_u.astype(precision), inflow_v.astype(precision)),
            slot_column=grid.rear,
            slot_rows=np.flatnonzero(self.slot_profile).astype(np.int64),
        )
        self._before = Flow.zeros(grid.shape, precision)
        self._rates = kernels.Pair(np.zeros_like(self._before.u), np.zeros_like(self._before.v))
        self._b = np.zeros(grid.shape, precision)
        self._phi = np.zeros(grid.shape, precision)

    def start(self) -> Flow:
        """Return a divergence-free uniform flow around the body; the first time steps from this flow must be small."""
        flow = Flow.zeros(self.grid.shape, self.precision)
        flow.faces_u[0] = self.domain.inflow.u
        flow.faces_u[1:][self.boundary.open_u[1:]] = 1.0
        self.run(flow, dt=1e-6, steps=1, action_from=0.0, action_to=0.0)
        flow.p[:] = 0.0
        return flow

    def run(
        self,
        flow: Flow,
        *,
        dt: float,
        steps: int,
        action_from: float,
        action_to: float,
        wind: Callable[[float], float] | None = None,
        starts: Array | None = None,
    ) -> None:
        """Take `steps` time steps in place while the action ramps linearly from `action_from` to `action_to`. `wind` is
        the excess of the stream's velocity over the inflow velocity, as a continuous function of the time since the run
        began. `starts` (steps, size of the buffer) receives the flow at the start of each step, for the adjoint.
        Restores the flow and raises PlantError if the new flow is not finite or is faster than physically possible."""
        self._before.flat[:] = flow.flat
        # The first stage multiplies the old rates by zero, but a NaN from a diverged run would remain NaN.
        self._rates.u[:] = 0.0
        self._rates.v[:] = 0.0
        slot_velocity = self.slot_velocity(action_from, action_to, steps)
        for step in range(steps):
            if starts is not None:
                starts[step] = flow.flat
            self._step(flow, dt, slot_velocity[step], *gusting(wind, dt, step))
        fastest = max(float(flow.u.max()), -float(flow.u.min()))
        if not fastest < 20.0:
            flow.flat[:] = self._before.flat
            before, rows = self._before, self.domain.slot_rows
            before.faces_u[self.domain.slot_column, rows] = (
                max(abs(action_from), abs(action_to)) * self.slot_profile[rows]
            )
            held = advice(self.grid, before, self.domain.viscosity, dt)
            raise PlantError(f"the flow diverged within {steps} steps of dt = {dt:.3g}: {held}")

    def slot_velocity(self, action_from: float, action_to: float, steps: int) -> Array:
        """Return the jets' velocities at the end of each stage of a ramp's steps, (steps, 3, slots' rows)."""
        actions = action_from + (action_to - action_from) * stage_ends(steps) / steps
        return np.multiply.outer(actions, self.slot_profile[self.domain.slot_rows]).astype(self.precision)

    def set_viscosity(self, viscosity: float) -> None:
        """Use another viscosity from the next step on."""
        self.domain = self.domain._replace(viscosity=viscosity)

    def _step(self, flow: Flow, dt: float, slot_velocity: Array, wind: Array, gained: Array) -> None:
        domain = self.domain
        walls = domain.walls
        kernels.stages(flow, self._rates, A, dt * B, slot_velocity, wind, gained, domain)
        kernels.clear_walls(flow.u, flow.v, walls)
        kernels.divergence(self._b, flow.u, flow.v, domain.spacing.dx, domain.spacing.dy, self.boundary.cell_runs)
        self.poisson.solve_into(self._b, self._phi)
        kernels.correct(flow, self._phi, dt, self.between, domain.spacing.dyc, domain.runs)
        kernels.fill_edges(flow.u, flow.v, domain.inflow.v)
        kernels.fill_walls(flow.u, flow.v, walls)

    def divergence(self, flow: Flow) -> Array:
        """Return the net outflow of each cell per unit area, (nx, ny). Ghosts carry no flow; solid cells have zero."""
        u, v = flow.u.copy(), flow.v.copy()
        kernels.clear_walls(u, v, self.domain.walls)
        b = np.zeros(self.grid.shape)
        kernels.divergence(b, u, v, self.grid.dx, self.grid.dy, self.boundary.cell_runs)
        return b / np.outer(self.grid.dx, self.grid.dy)


def stage_ends(steps: int) -> Array:
    """Return the time at the end of each stage, (steps, 3), in units of a step from the first step's start."""
    return np.add.outer(np.arange(steps), STAGE_END)


def gusting(wind: Callable[[float], float] | None, dt: float, step: int) -> tuple[Array, Array]:
    """Return the wind at the end of each stage of a step, and the wind's change during each stage."""
    if wind is None:
        return _STEADY, _STEADY
    values = np.array([wind(dt * (step + end)) for end in (0.0, *STAGE_END)])
    return values[1:], np.diff(values)


CONVECTIVE_LIMIT: Final = 2.0
JET_LIMIT: Final = 4.0
VISCOUS_LIMIT: Final = 2.51
_SAFE: Final = 1.7
"""Largest convective and viscous number of the time step that `advice` recommends."""


def advice(grid: Grid, before: Flow, viscosity: float, dt: float) -> str:
    """Return the message for a run that began with the flow `before` and diverged with the time step `dt`. It states
    the largest convective and viscous number of all cells, and a stable time step."""
    u, v = np.abs(before.faces_u), np.abs(before.faces_v)
    along = np.maximum(u[:-1], u[1:]) / grid.dx[:, None]
    across = np.maximum(v[:, :-1], v[:, 1:]) / grid.dy
    convective = float(dt * (along + across).max())
    viscous = float(4.0 * viscosity * dt * (1.0 / grid.dx.min() ** 2 + 1.0 / grid.dy.min() ** 2))
    held = dt / max(2.0, convective / _SAFE, viscous / _SAFE)
    return (
        f"convective number {convective:.2f} before the run (must be below {CONVECTIVE_LIMIT:g}), viscous number "
        f"{viscous:.2f} (must be below {VISCOUS_LIMIT:g}): take dt = {held:.2g}"
    )


def check_step(grid: Grid, fluid: Mask, viscosity: float, jet_speed: float, period: float, substeps: int) -> None:
    """Check, before any flow exists, that a time step is not too large for this grid. Raises PlantError with the
    excessive number and a sufficient number of substeps. `jet_speed` is the largest jet speed that can be commanded,
    in U_inf; `period` is the control period in t_c."""
    dt = period / substeps
    per_x, per_y = 1.0 / grid.dx[:, None], 1.0 / grid.dy
    slot = slice(grid.upper - grid.slot_cells, grid.upper)
    # At the front corners, both velocity components reach about the free-stream speed. A blowing jet turns by 90
    # degrees within one cell, so both components reach the jet's speed. A sucking jet draws an equal flow along the
    # base.
    numbers = (
        ("convective number of the free stream", np.where(fluid, per_x + per_y, 0.0).max(), CONVECTIVE_LIMIT),
        ("convective number of the jets", jet_speed * (per_x[grid.rear, 0] + per_y[slot].max()), JET_LIMIT),
        ("viscous number", 4.0 * viscosity * np.where(fluid, per_x**2 + per_y**2, 0.0).max(), VISCOUS_LIMIT),
    )
    name, rate, limit = max(numbers, key=lambda entry: entry[1] / entry[2])
    if dt * rate > limit:
        raise PlantError(
            f"dt = {dt:.3g} ({period:g} t_c in {substeps} substeps): the {name} is {dt * rate:.2f} on this grid, but "
            f"must be below {limit:g}: take at least {ceil(period * rate / limit)} substeps"
        )
