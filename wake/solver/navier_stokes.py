"""Incompressible Navier-Stokes in time: three-stage Runge-Kutta, one pressure projection a step.

The stages carry the pressure gradient of the step's start, the projection adds its change (Williamson's low-storage
coefficients; second order in time for the velocity, because the stages' divergence enters at second order). Boundary
conditions: uniform inflow, slip sides, p = 0 and zero normal gradient at the outlet, no slip on the body, prescribed
flow through the slots. The outlet's velocity solves the momentum equation like any other, with a mirrored cell behind
it; copying it from upstream instead would leave the last cells no transverse flow, and a vortex that leaves would shake
the pressure everywhere. Pressure here is kinematic, p / (rho U_inf^2); Cp is twice that.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from threadpoolctl import ThreadpoolController

from contract.errors import PlantError
from wake.solver import kernels, poisson, stability
from wake.solver.boundary import Boundary
from wake.solver.grid import Grid

Array = npt.NDArray[np.float64]

# Williamson's RK3: q = A q + dt rate, velocity += B q; STAGE_END are the instants the stages reach.
_A = (0.0, -5.0 / 9.0, -153.0 / 128.0)
_B = (1.0 / 3.0, 15.0 / 16.0, 8.0 / 15.0)
_STAGE_END = (1.0 / 3.0, 3.0 / 4.0, 1.0)

# One BLAS thread: the matrices are small, and several plants usually share the cores.
_THREADS = ThreadpoolController()


@dataclass(frozen=True, kw_only=True, eq=False)
class Flow:
    """Velocity and pressure in one buffer, `flat`; u, v and p are padded views of it (see `wake.solver.kernels`)."""

    flat: Array
    u: Array
    v: Array
    p: Array

    @classmethod
    def zeros(cls, shape: tuple[int, int]) -> "Flow":
        nx, ny = shape
        return cls.of(np.zeros((nx + 2) * (ny + 2) + (nx + 2) * (ny + 1) + (nx + 1) * ny), shape)

    @classmethod
    def of(cls, flat: Array, shape: tuple[int, int]) -> "Flow":
        nx, ny = shape
        nu, nv = (nx + 2) * (ny + 2), (nx + 2) * (ny + 1)
        return cls(
            flat=flat,
            u=flat[:nu].reshape(nx + 2, ny + 2),
            v=flat[nu : nu + nv].reshape(nx + 2, ny + 1),
            p=flat[nu + nv :].reshape(nx + 1, ny),
        )


class FlowSolver:
    """Advances a `Flow` on one grid around one body.

    Args:
        grid: the grid.
        boundary: its classification.
        viscosity: 1 / Re.
        slot_profile: velocity on the faces at `grid.rear` per unit action, (ny,); None for no jets.
        inflow_u, inflow_v: velocity at the inlet, (ny,) at the u-faces and (ny + 1,) at the v-faces.
    """

    def __init__(
        self,
        grid: Grid,
        boundary: Boundary,
        viscosity: float,
        slot_profile: Array | None = None,
        inflow_u: Array | None = None,
        inflow_v: Array | None = None,
    ) -> None:
        nx, ny = grid.shape
        self.grid = grid
        self.boundary = boundary
        self.viscosity = viscosity
        self._poisson = poisson.build(grid, boundary.fluid)
        self._profile = np.zeros(ny) if slot_profile is None else slot_profile
        self._slot_rows = np.flatnonzero(self._profile).astype(np.int64)
        self._inflow_u = np.ones(ny) if inflow_u is None else inflow_u
        self._inflow_v = np.zeros(ny + 1) if inflow_v is None else inflow_v
        # Spacings with the mirrored cells before the inlet and behind the outlet.
        dxc = grid.dxc.copy()
        dxc[0], dxc[-1] = grid.dx[0], grid.dx[-1]
        self._spacing = (np.append(grid.dx, grid.dx[-1]), dxc, grid.dy, grid.dyc)
        self._qu = np.zeros((nx + 2, ny + 2))
        self._qv = np.zeros((nx + 2, ny + 1))
        self._b = np.zeros((nx, ny))
        self._phi = np.zeros((nx, ny))
        self._before = Flow.zeros(grid.shape)

    def start(self) -> Flow:
        """Uniform flow around the body, made divergence-free: a start to be followed by small steps."""
        flow = Flow.zeros(self.grid.shape)
        flow.u[0, 1:-1] = self._inflow_u
        flow.u[1:-1, 1:-1][self.boundary.open_u[1:]] = 1.0
        self.run(flow, dt=1e-6, steps=1, action_from=0.0, action_to=0.0)
        flow.p[:] = 0.0
        return flow

    def run(self, flow: Flow, *, dt: float, steps: int, action_from: float, action_to: float) -> None:
        """Take `steps` time steps in place while the action ramps linearly between the two values.

        Raises:
            PlantError: if the flow is no longer finite or faster than any physical one here; it is left as it was.
        """
        self._before.flat[:] = flow.flat
        # The first stage multiplies the old rate by zero, which would keep what a diverged run left there.
        self._qu[:] = 0.0
        self._qv[:] = 0.0
        with _THREADS.limit(limits=1, user_api="blas"):
            for step in range(steps):
                ramp = [action_from + (action_to - action_from) * (step + end) / steps for end in _STAGE_END]
                self._step(flow, dt, ramp)
        fastest = max(float(flow.u.max()), -float(flow.u.min()))
        if not fastest < 20.0:
            flow.flat[:] = self._before.flat
            raise self._diverged(dt, steps, max(abs(action_from), abs(action_to)))

    def _diverged(self, dt: float, steps: int, action: float) -> PlantError:
        flow, rear = self._before, self.grid.rear
        flow.u[rear, self._slot_rows + 1] = action * self._profile[self._slot_rows]
        convective = stability.convective_number(self.grid, flow.u, flow.v, dt)
        viscous = stability.viscous_number(self.grid, self.viscosity, dt)
        return PlantError(
            f"the flow diverged within {steps} steps of dt = {dt:.3g}: {stability.advice(convective, viscous, dt)}"
        )

    def _step(self, flow: Flow, dt: float, actions: list[float]) -> None:
        grid, boundary = self.grid, self.boundary
        walls = (boundary.u_ghosts.arrays(), boundary.v_ghosts.arrays())
        for a, b, action in zip(_A, _B, actions, strict=True):
            kernels.stage(
                flow.u, flow.v, flow.p, self._qu, self._qv, a, dt * b, self.viscosity,
                self._spacing, boundary.u_runs, boundary.v_runs, *walls,
                self._inflow_u, self._inflow_v, grid.rear, self._slot_rows, action * self._profile[self._slot_rows],
            )  # fmt: skip
        kernels.clear_walls(flow.u, flow.v, *walls)
        kernels.divergence(self._b, flow.u, flow.v, grid.dx, grid.dy, boundary.cell_runs)
        self._poisson.solve_into(self._b, self._phi)
        kernels.correct(flow.u, flow.v, flow.p, self._phi, dt, grid.dxc, grid.dyc, boundary.u_runs, boundary.v_runs)
        kernels.fill_edges(flow.u, flow.v, self._inflow_v)
        kernels.fill_walls(flow.u, flow.v, *walls)

    def divergence(self, flow: Flow) -> Array:
        """Net outflow of every fluid cell per unit area, (nx, ny), ghosts carrying none; zero in solid cells."""
        u, v = flow.u.copy(), flow.v.copy()
        kernels.clear_walls(u, v, self.boundary.u_ghosts.arrays(), self.boundary.v_ghosts.arrays())
        b = np.zeros(self.grid.shape)
        kernels.divergence(b, u, v, self.grid.dx, self.grid.dy, self.boundary.cell_runs)
        return b / np.outer(self.grid.dx, self.grid.dy)
