"""What int8 weights cost the controller: the difference in actions, and the cost of acting on them.

Bits do not matter here, behaviour does: both programs answer the same windows from the same warm start, and
the quantised one's plan is priced by the float one's model.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from contract.arrays import Array
from contract.controller.goal import Goal
from contract.controller.interface import ControlStep
from contract.errors import ExportError
from export.gates.parity import case_speed
from export.program.controller_program import ControllerProgram
from export.reference.model import encode
from export.reference.mpc import control_step, evaluate, starting_plan


@dataclass(frozen=True, kw_only=True)
class QuantisationLimits:
    """What is accepted.

    Attributes:
        rms_action_error: on the commanded action a_t, in U_inf W. One step moves an action by up to about
            iterations * lr (5e-3 at the paper's setting); the default is a fifth of that. The largest error is
            reported but not limited: Adam follows the sign of a gradient, and wherever that is close to zero
            the two programs may step apart at next to no cost.
        max_cost_gap: on J, in units of Cd.
    """

    rms_action_error: float = 1e-3
    max_cost_gap: float = 1e-3


@dataclass(frozen=True, kw_only=True)
class QuantisationReport:
    """Differences of the quantised from the float program over `cases` control steps.

    Attributes:
        max_action_error, rms_action_error: of the commanded action a_t, in U_inf W.
        max_plan_error: of any action of a plan.
        max_cost_gap, mean_cost_gap: J(quantised plan) - J(float plan), both under the float program and its own
            weights; positive where the quantised plan is worse.
    """

    cases: int
    max_action_error: float
    rms_action_error: float
    max_plan_error: float
    max_cost_gap: float
    mean_cost_gap: float


Answer = Callable[[Array, Array, Array, Array | None, float, float | None], ControlStep]
"""`Controller.control_step`."""


def exact_answers(program: ControllerProgram, windows: Iterable[Array]) -> list[ControlStep]:
    """The float program's answers to consecutive windows (L, S+1), each plan the warm start of the next.

    Where the program depends on them, windows are answered at several speeds and for several goals in turn.
    """
    plan, free = np.zeros(program.mpc.horizon), np.ones(program.mpc.horizon)
    found = []
    for number, window in enumerate(windows):
        found.append(control_step(program, window, plan, free, *_asked(program, number)))
        plan = found[-1].plan
    return found


def compare_answers(
    program: ControllerProgram, answer: Answer, windows: Sequence[Array], exact_steps: Sequence[ControlStep]
) -> QuantisationReport:
    """Answer the windows of `exact_answers` with another lowering; the float plan is the warm start of both. Raises
    ExportError if there are no windows."""
    h = program.mpc.horizon
    plan, free = np.zeros(h), np.ones(h)
    weights = np.array(program.mpc.weights.as_tuple())
    errors, gaps = [], []
    for number, (window, exact) in enumerate(zip(windows, exact_steps, strict=True)):
        asked = _asked(program, number)
        rounded = answer(window, plan, free, *asked)
        start = starting_plan(program, window, plan, free, *asked)
        priced = evaluate(program, encode(program, window), rounded.plan, float(window[-1, -1]), weights, start)
        errors.append(rounded.plan - exact.plan)
        gaps.append(float((priced.terms - exact.terms) @ weights))
        plan = exact.plan
    if not errors:
        raise ExportError("quantisation gate: no windows to compare on")
    error = np.array(errors)
    return QuantisationReport(
        cases=len(errors),
        max_action_error=float(np.abs(error[:, 0]).max()),
        rms_action_error=float(np.sqrt((error[:, 0] ** 2).mean())),
        max_plan_error=float(np.abs(error).max()),
        max_cost_gap=float(np.max(gaps)),
        mean_cost_gap=float(np.mean(gaps)),
    )


def _asked(program: ControllerProgram, number: int) -> tuple[Array | None, float, float | None]:
    """Weights, speed and limit: the program's own, or every second time those in the middle of what a prior knows."""
    speed, own = case_speed(program, number), program.mpc.weights
    if program.prior is None or number % 2 == 0:
        return None, speed, None
    halfway = Goal(0.5, 0.5, 0.5)
    effort, lift = (price * own.drag_mean for price in halfway.prices())
    goal = replace(own, effort=effort, lift=lift)
    return np.array(goal.as_tuple()), speed, halfway.share_of_limit() * program.action_limit


def check_quantisation(report: QuantisationReport, limits: QuantisationLimits, *, name: str = "int8 weights") -> None:
    """Raise ExportError, naming what was compared and the figure, if the report exceeds a limit."""
    for figure in ("rms_action_error", "max_cost_gap"):
        found, allowed = getattr(report, figure), getattr(limits, figure)
        # Written so that a NaN fails.
        if not found <= allowed:
            raise ExportError(
                f"{name}: {figure} is {found:.2g}, at most {allowed:.2g} is allowed; "
                "train longer, or export with --precision float32"
            )
