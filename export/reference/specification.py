"""The specification of either kind of controller, by the kind of its program."""

from contract.arrays import Array
from contract.controller.interface import ControlStep
from export.program.controller_program import ControllerProgram
from export.program.linear_program import LinearProgram
from export.reference.linear import linear_control_step
from export.reference.mpc import control_step

AnyProgram = ControllerProgram | LinearProgram
"""What a lowering computes."""


def specified_step(
    program: AnyProgram,
    window: Array,
    plan: Array,
    free: Array,
    weights: Array | None = None,
    speed: float = 1.0,
) -> ControlStep:
    """One control step in float64; arguments as in `contract.controller.interface`.

    A linear controller does not know the speed.
    """
    if isinstance(program, LinearProgram):
        return linear_control_step(program, window, plan, free, weights)
    return control_step(program, window, plan, free, weights, speed)
