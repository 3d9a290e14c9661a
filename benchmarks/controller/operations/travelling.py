"""A road as the ECU's controller."""

import numpy as np

from benchmarks.controller.operations.road import Memory, Problem, Road
from contract.arrays import Array
from contract.controller.interface import ControlStep
from export.program.controller_program import ControllerProgram
from export.reference.model import encode
from export.reference.mpc import evaluate, shift


class TravellingController:
    """A control step by a road, in NumPy; it keeps the road's memory between its calls."""

    def __init__(self, program: ControllerProgram, road: Road) -> None:
        self.description = f"NumPy, {road.name}, {road.iterations} iterations"
        self._program, self._road, self._memory = program, road, Memory()

    def warm_up(self, steps: int) -> None:
        """Nothing happens once."""

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> ControlStep:
        """As the interface's."""
        program, before = self._program, float(window[-1, -1])
        z = encode(program, window)
        chosen = np.array(program.mpc.weights.as_tuple()) if weights is None else weights
        problem = Problem(
            program=program,
            z=z[None],
            start=shift(plan)[None],
            previous_action=np.array([before]),
            free=free > 0.5,
            weights=chosen,
        )
        plans, self._memory = self._road.plan(problem, self._memory)
        return evaluate(program, z, plans[0], before, chosen)
