"""The time integration of the incompressible Navier-Stokes equations: three Runge-Kutta stages and one pressure
projection per step.

The stages have Williamson's low-storage coefficients and use the pressure gradient of the step's start. The projection
adds the gradient's change. The velocity is of second order in time. The boundary conditions are uniform inflow, slip
sides, p = 0 and zero normal gradient at the outlet, no slip on the body, and prescribed flow through the slots. The
velocity at the outlet solves the momentum equation, as in the interior, with a mirrored cell beyond the outlet. If it
were copied from upstream, a vortex that leaves the domain would disturb the pressure everywhere. Pressure here is
kinematic, p / (rho U_inf^2); Cp is twice this pressure.

A varying wind is given in the frame of the body, as for a vehicle whose speed through the air varies. A change of the
wind changes the inflow, and accelerates the whole flow uniformly. So the far pressure does not change.
"""

from collections.abc import Callable

import numpy as np

from contract.arrays import Array, Precision
from contract.errors import PlantError
from contract.runtime.copies import CopiedWhole
from wake.solver import kernels, poisson, stability
from wake.solver.boundary import Boundary
from wake.solver.flow import Flow
from wake.solver.grid import Grid

# Williamson's RK3 computes q = A q + dt rate, velocity += B q. STAGE_END has the times at which the stages end, as
# fractions of the step.
A = np.array([0.0, -5.0 / 9.0, -153.0 / 128.0])
B = np.array([1.0 / 3.0, 15.0 / 16.0, 8.0 / 15.0])
STAGE_END = (1.0 / 3.0, 3.0 / 4.0, 1.0)
_STEADY = np.zeros(len(STAGE_END))


class FlowSolver(CopiedWhole):
    """A time integration of a `Flow` on one grid around one body.

    Args:
        viscosity: 1 / Re.
        slot_profile: velocity on the faces at `grid.rear` per unit action, (ny,); None for no jets.
        inflow_u, inflow_v: velocity at the inlet, (ny,) at the u-faces and (ny + 1,) at the v-faces.
        precision: precision of the flows; the grid and the projection's factors are computed in double precision first.
    """

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
        self.precision = precision
        self.grid = grid
        self.boundary = boundary
        self.viscosity = viscosity
        self.poisson = poisson.build(grid, boundary.fluid, precision)
        self.slot_profile = np.zeros(ny) if slot_profile is None else slot_profile
        # The projection has no mirrored cells, so it uses the grid's own spacings.
        self.between = grid.dxc.astype(precision)
        dxc = grid.dxc.copy()
        dxc[0], dxc[-1] = grid.dx[0], grid.dx[-1]
        self.domain = kernels.Domain(
            viscosity=viscosity,
            spacing=kernels.Spacing(
                *(each.astype(precision) for each in (np.append(grid.dx, grid.dx[-1]), dxc, grid.dy, grid.dyc))
            ),
            runs=kernels.Runs(u=boundary.u_runs, v=boundary.v_runs),
            walls=kernels.Walls(
                *(
                    ghosts._replace(weight=ghosts.weight.astype(precision))
                    for ghosts in (boundary.u_ghosts, boundary.v_ghosts)
                )
            ),
            inflow=kernels.Inflow(
                u=(np.ones(ny) if inflow_u is None else inflow_u).astype(precision),
                v=(np.zeros(ny + 1) if inflow_v is None else inflow_v).astype(precision),
            ),
            slot_column=grid.rear,
            slot_rows=np.flatnonzero(self.slot_profile).astype(np.int64),
        )
        self._before = Flow.zeros(grid.shape, precision)
        self._rates = kernels.Rates(u=np.zeros_like(self._before.u), v=np.zeros_like(self._before.v))
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
        """Take `steps` time steps in place while the action ramps linearly between the two values. Raises PlantError,
        and restores the flow, if the new flow is not finite or is faster than is physically possible in this flow.

        Args:
            wind: excess of the stream's velocity over the inflow velocity, as a continuous function of the time since
                the run began.
            starts: (steps, size of the buffer); receives the flow at the start of each step, for the adjoint.
        """
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
            advice = stability.advice(self.grid, before, self.viscosity, dt)
            raise PlantError(f"the flow diverged within {steps} steps of dt = {dt:.3g}: {advice}")

    def slot_velocity(self, action_from: float, action_to: float, steps: int) -> Array:
        """Return the jets' velocities at the end of each stage of a ramp's steps, (steps, 3, slots' rows)."""
        actions = action_from + (action_to - action_from) * stage_ends(steps) / steps
        return np.multiply.outer(actions, self.slot_profile[self.domain.slot_rows]).astype(self.precision)

    def set_viscosity(self, viscosity: float) -> None:
        """Use another viscosity from the next step on."""
        self.viscosity = viscosity
        self.domain = self.domain._replace(viscosity=viscosity)

    def _step(self, flow: Flow, dt: float, slot_velocity: Array, wind: Array, gained: Array) -> None:
        domain = self.domain
        fields, walls = kernels.Fields(u=flow.u, v=flow.v, p=flow.p), domain.walls
        kernels.stages(fields, self._rates, A, dt * B, slot_velocity, wind, gained, domain)
        kernels.clear_walls(flow.u, flow.v, walls)
        kernels.divergence(self._b, flow.u, flow.v, domain.spacing.dx, domain.spacing.dy, self.boundary.cell_runs)
        self.poisson.solve_into(self._b, self._phi)
        kernels.correct(fields, self._phi, dt, self.between, domain.spacing.dyc, domain.runs)
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
    """Return the end of each stage as a time since the first step's beginning, in units of a step, (steps, 3)."""
    return np.add.outer(np.arange(steps), STAGE_END)


def gusting(wind: Callable[[float], float] | None, dt: float, step: int) -> tuple[Array, Array]:
    """Return the wind at the end of each stage of a step, and the wind's change during each stage."""
    if wind is None:
        return _STEADY, _STEADY
    values = np.array([wind(dt * (step + end)) for end in (0.0, *STAGE_END)])
    return values[1:], np.diff(values)
