"""The adjoint of the flow solver: the exact transpose of the discrete step, except for rounding. It gives a scalar's
sensitivities to an earlier flow and to the actions, if the scalar depends on later flows. The projection's operator is
symmetric, so solver and adjoint use the same Poisson solver."""

from collections.abc import Callable

import numpy as np

from contract.arrays import Array
from contract.runtime.copies import CopiedWhole
from wake.solver import adjoint_kernels, kernels
from wake.solver.flow import Flow
from wake.solver.navier_stokes import A, B, FlowSolver, gusting, stage_ends


class FlowAdjoint(CopiedWhole):
    """A backward integration of sensitivities over the runs of a `FlowSolver`, with the solver's present viscosity."""

    def __init__(self, solver: FlowSolver) -> None:
        self._solver = solver
        shape = solver.grid.shape
        self._work = Flow.zeros(shape, solver.precision)
        self._rates, self._second = (
            kernels.Pair(np.zeros_like(self._work.u), np.zeros_like(self._work.v)) for _ in range(2)
        )
        self._phi, self._b = np.zeros(shape, solver.precision), np.zeros(shape, solver.precision)

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
        """Propagate sensitivities from a run's end to its beginning. Returns the sensitivities to `action_from` and
        `action_to`.

        Args:
            bar: sensitivities to the flow at the run's end; overwritten with those to the flow at its beginning.
            starts: the flows that `FlowSolver.run` stored, (steps, size of the buffer).
            dt, action_from, action_to, wind: the arguments with which `FlowSolver.run` was called.
        """
        solver, steps = self._solver, len(starts)
        slot_velocity = solver.slot_velocity(action_from, action_to, steps)
        slot_bar = np.zeros_like(slot_velocity)
        for step in range(steps - 1, -1, -1):
            self._step(bar, starts[step], dt, slot_velocity[step], slot_bar[step], *gusting(wind, dt, step))
        to_actions = slot_bar @ solver.slot_profile[solver.domain.slot_rows]
        ramp = stage_ends(steps) / steps
        return float(np.sum((1.0 - ramp) * to_actions)), float(np.sum(ramp * to_actions))

    def _step(
        self, bar: Flow, start: Array, dt: float, slot_velocity: Array, slot_bar: Array, wind: Array, gained: Array
    ) -> None:
        solver, domain, walls = self._solver, self._solver.domain, self._solver.domain.walls
        adjoint_kernels.back_walls(bar.u, bar.v, walls)
        adjoint_kernels.back_edges(bar.u, bar.v)
        adjoint_kernels.back_correct(bar, self._phi, dt, solver.between, domain.spacing.dyc, domain.runs)
        solver.poisson.solve_into(self._phi, self._b)
        adjoint_kernels.back_divergence(
            self._b, bar.u, bar.v, domain.spacing.dx, domain.spacing.dy, solver.boundary.cell_runs
        )
        kernels.clear_walls(bar.u, bar.v, walls)
        self._work.flat[:] = start
        adjoint_kernels.back_stages(
            bar,
            slot_bar,
            Flow.of(start, solver.grid.shape),
            self._work,
            self._rates,
            self._second,
            A,
            dt * B,
            slot_velocity,
            wind,
            gained,
            domain,
        )
