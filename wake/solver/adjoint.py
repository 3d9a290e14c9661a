"""The adjoint of the flow solver: what a scalar of later flows gains per unit of an earlier flow and of the actions.

It is the transpose of the discrete step, exact to rounding, not a discretised adjoint equation: the gradient is that of
the numbers which the solver computes. The projection's operator is symmetric and serves both ways.
"""

from collections.abc import Callable

import numpy as np

from contract.arrays import Array
from contract.runtime.copies import CopiedWhole
from wake.solver import adjoint_kernels, kernels
from wake.solver.flow import Flow
from wake.solver.navier_stokes import STAGE_END, A, B, FlowSolver, gusting


class FlowAdjoint(CopiedWhole):
    """Carries sensitivities backwards over the runs of a `FlowSolver`, whose present viscosity it uses."""

    def __init__(self, solver: FlowSolver) -> None:
        self._solver = solver
        shape = solver.grid.shape
        self._work = Flow.zeros(shape)
        self._rates = kernels.Rates(u=np.zeros_like(self._work.u), v=np.zeros_like(self._work.v))
        self._second = kernels.Rates(u=np.zeros_like(self._work.u), v=np.zeros_like(self._work.v))
        self._phi, self._b = np.zeros(shape), np.zeros(shape)

    def run(
        self,
        bar: Flow,
        starts: Array,
        *,
        dt: float,
        action_from: float,
        action_to: float,
        wind: Callable[[float], float] | None = None,
    ) -> tuple[float, float]:
        """Carry sensitivities from the end of a run to its beginning. Returns the sensitivities to `action_from` and to
        `action_to`.

        Args:
            bar: sensitivities to the flow at the end; made those to the flow at the beginning, in place.
            starts: what `FlowSolver.run` kept of the run, (steps, size of the buffer).
            dt, action_from, action_to, wind: as they were in the run.
        """
        to_from = to_to = 0.0
        steps = len(starts)
        for step in range(steps - 1, -1, -1):
            ramp = (step + np.array(STAGE_END)) / steps
            actions = action_from + (action_to - action_from) * (step + np.array(STAGE_END)) / steps
            to_actions = self._step(bar, starts[step], dt, actions, *gusting(wind, dt, step))
            to_to += float(ramp @ to_actions)
            to_from += float((1.0 - ramp) @ to_actions)
        return to_from, to_to

    def _step(self, bar: Flow, start: Array, dt: float, actions: Array, wind: Array, gained: Array) -> Array:
        solver, domain = self._solver, self._solver.domain
        grid, walls = solver.grid, domain.walls
        bars = kernels.Fields(u=bar.u, v=bar.v, p=bar.p)
        profile = solver.slot_profile[domain.slot_rows]
        slot_velocity = np.multiply.outer(actions, profile)
        slot_bar = np.zeros_like(slot_velocity)
        adjoint_kernels.back_walls(bar.u, bar.v, walls)
        adjoint_kernels.back_edges(bar.u, bar.v)
        adjoint_kernels.back_correct(bars, self._phi, dt, grid.dxc, grid.dyc, domain.runs)
        solver.poisson.solve_into(self._phi, self._b)
        adjoint_kernels.back_divergence(self._b, bar.u, bar.v, grid.dx, grid.dy, solver.boundary.cell_runs)
        kernels.clear_walls(bar.u, bar.v, walls)
        flow, work = Flow.of(start, grid.shape), self._work
        adjoint_kernels.back_stages(
            bars,
            slot_bar,
            kernels.Fields(u=flow.u, v=flow.v, p=flow.p),
            kernels.Fields(u=work.u, v=work.v, p=work.p),
            self._rates,
            self._second,
            A,
            dt * B,
            slot_velocity,
            wind,
            gained,
            domain,
        )
        return slot_bar @ profile
