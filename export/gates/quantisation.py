"""The effect of int8 weights on the controller: the difference in actions, and the resulting difference in cost. Both
programs start from equal windows and previous plans. The float program's model computes the cost of both plans."""

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
    """The limits of the gate.

    Attributes:
        rms_action_error: largest permitted rms error of the commanded action a_t, in U_inf W; the default is a fifth of
            the largest move in a control step. This move is iterations * learning rate (5e-3 with the paper's
            settings). The largest error has no limit. If a gradient is close to zero, Adam may move an action in
            opposite directions in the two programs, but the cost hardly changes.
        max_cost_gap: largest permitted increase of the cost J, in units of Cd.
    """

    rms_action_error: float = 1e-3
    max_cost_gap: float = 1e-3


@dataclass(frozen=True, kw_only=True)
class QuantisationReport:
    """The differences between the quantised and the float program over `cases` control steps. Errors of the commanded
    action a_t and of all actions of a plan are in U_inf W. The cost gap is J(quantised plan) - J(float plan); the float
    program computes both. The gap is positive if the quantised plan is worse."""

    cases: int
    max_action_error: float
    rms_action_error: float
    max_plan_error: float
    max_cost_gap: float
    mean_cost_gap: float


Answer = Callable[[Array, Array, Array, Array | None, float, float | None], ControlStep]
"""A function with the arguments and the result of `Controller.control_step`."""


def exact_answers(program: ControllerProgram, windows: Iterable[Array]) -> list[ControlStep]:
    """Compute the float program's control steps for consecutive windows (L, S+1); each step starts from the plan of the
    step before. Speeds and goals vary from window to window if the program depends on them."""
    plan, free = np.zeros(program.mpc.horizon), np.ones(program.mpc.horizon)
    found = []
    for number, window in enumerate(windows):
        found.append(control_step(program, window, plan, free, *_asked(program, number)))
        plan = found[-1].plan
    return found


def compare_answers(
    program: ControllerProgram, answer: Answer, windows: Sequence[Array], exact_steps: Sequence[ControlStep]
) -> QuantisationReport:
    """Compute the control steps of `exact_answers` with a lowering, and compare them with the exact steps. In each
    step, both programs start from the float program's previous plan. Raises ExportError if there are no windows."""
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
        raise ExportError("quantisation gate: no windows to compare with")
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
    """Return weights, speed and limit for the window with this number; None stands for the program's weights or limit.
    If the program has a prior, every second window has weights and a limit in the middle of the prior's range."""
    speed, own = case_speed(program, number), program.mpc.weights
    if program.prior is None or number % 2 == 0:
        return None, speed, None
    halfway = Goal(0.5, 0.5, 0.5)
    effort, lift = (price * own.drag_mean for price in halfway.prices())
    goal = replace(own, effort=effort, lift=lift)
    return np.array(goal.as_tuple()), speed, halfway.share_of_limit() * program.action_limit


def check_quantisation(report: QuantisationReport, limits: QuantisationLimits, *, name: str = "int8 weights") -> None:
    """Raise ExportError if the report exceeds a limit; the message states the name of the compared lowering and the
    exceeded figure."""
    for figure in ("rms_action_error", "max_cost_gap"):
        found, allowed = getattr(report, figure), getattr(limits, figure)
        # The comparison is written so that NaN fails the gate too.
        if not found <= allowed:
            raise ExportError(
                f"{name}: {figure} is {found:.2g}, at most {allowed:.2g} is allowed; "
                "train longer, or export with --precision float32"
            )
