"""The checks (gates) that a lowering (an ONNX graph or a C library) must pass before any file is written.

The first gate computes the same control steps with the reference and with the lowering, and limits the differences.
float32 has about 7 digits, and a roll-out of 25 steps with layer norms raises rounding errors to about 1e-6 in a force
of order 1. Adam moves an action by about the learning rate per iteration, whatever the gradient's size, so most actions
agree to 1e-7. But if a component of the gradient is near Adam's epsilon, or the two results lie on different sides of a
kink of |Cl| or max Cd, the moves differ by a part of the learning rate. The second gate limits the differences that
int8 weights cause in actions and in cost.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from contract.arrays import Array
from contract.controller.goal import Goal
from contract.controller.interface import TERMS, Controller, ControlStep
from contract.errors import ExportError
from export.program.controller_program import ControllerProgram, random_window
from export.reference.model import encode
from export.reference.mpc import control_step, evaluate, starting_plan

SPEEDS: Final = (1.0, 0.6, 1.4)
"""Speeds of the vehicle, as ratios to the design speed; used in turn in the test cases if plans depend on it."""
LIMITS: Final = (1.0, 0.8, 0.3, 1.2, 0.55)
"""Bounds on the action's magnitude |a|, as fractions of the controller's bound; used in turn in the test cases."""
BEYOND: Final = 100.0
"""Factor of the weights of effort and lift in every fourth test case, beyond the range of the prior's training."""
MOVE: Final = 5e-3
"""Largest allowed difference of an action, as a fraction of Adam's largest move (iterations * learning rate). With the
paper's settings, this difference is 2.5e-5 U_inf W."""
FORCE: Final = 1e-4
"""Largest allowed difference of a predicted Cd or Cl, divided by the largest force, or by 1 if 1 is larger."""
COST: Final = 1e-4
"""Largest allowed difference of a cost term or the cost J, divided by the largest term or J, or by 1 if 1 is larger."""
QUANTISATION_LIMITS: Final[Mapping[str, float]] = {"rms_action_error": 1e-3, "max_cost_gap": 1e-3}
"""Limits for two results of `compare_answers` with int8 weights. The rms error of the commanded action a_t, in U_inf W,
may be a fifth of the largest move of an action in a control step (iterations * learning rate, 5e-3 with the paper's
settings). The error of a single action has no limit: if a gradient is close to zero, Adam may move an action in
opposite directions in the two programs, but the cost hardly changes. The cost gap is the increase of J, as a Cd."""

Figures = dict[str, float]
"""The results of a gate by name. "cases" is the number of control steps."""


class ControlCase(NamedTuple):
    """The arguments of `Controller.control_step` in order, all of them exact in float32."""

    window: Array
    plan: Array
    free: Array
    weights: Array | None
    speed: float = 1.0
    limit: float | None = None


def control_cases(
    program: ControllerProgram, windows: Sequence[Array] | None = None, *, count: int = 20, seed: int = 0
) -> Iterator[ControlCase]:
    """Yield the arguments of control steps for recorded windows (L, S+1) or, without `windows`, for `count` random
    windows. The previous plan is random. Up to a quarter of the plan is committed: these actions must not change. In
    every second step the cost weights differ from their defaults and are all above zero."""
    rng = np.random.default_rng(seed)
    h, limit = program.mpc.horizon, program.action_limit
    for i in range(count if windows is None else len(windows)):
        window = random_window(program, rng) if windows is None else windows[i]
        free = np.ones(h)
        free[: rng.integers(0, h // 4 + 1)] = 0.0
        weights = rng.uniform(0.5, 2.0, 8) * [1.0, 0.1, 0.05, 0.2, 4.0, 1.0, 4.0, 2.0] if i % 2 else None
        if weights is not None and i % 4 == 3:
            weights[[TERMS.index("effort"), TERMS.index("lift")]] *= BEYOND
        # The actions stay slightly below the limit, because rounding to float32 may increase them.
        plan = 0.999 * limit * rng.uniform(-1.0, 1.0, h)
        yield ControlCase(
            window=_as_float32(window),
            plan=_as_float32(plan),
            free=free,
            weights=None if weights is None else _as_float32(weights),
            speed=case_speed(program, i),
            limit=float(np.float32(LIMITS[i % len(LIMITS)] * limit)),
        )


def case_speed(program: ControllerProgram, number: int) -> float:
    """Return the vehicle's speed in the case with this number, as a ratio to the design speed."""
    return float(np.float32(SPEEDS[number % len(SPEEDS)])) if program.knows_speed else 1.0


def check_lowering(program: ControllerProgram, lowering: Controller, name: str, windows: Sequence[Array]) -> Figures:
    """Compare a lowering with the reference. Returns the number of cases and the largest differences of actions in
    U_inf W, of forces, and of costs or terms. Raises ExportError if a difference exceeds its tolerance or is NaN.
    `program` is the program that the lowering should compute; for an int8 lowering, `program` has the dequantised
    weights. `windows` are recorded windows (L, S+1) of L rows and S sensors, one per case."""
    differences = []
    for case in control_cases(program, windows):
        expected = control_step(program, *case)
        found = lowering.control_step(*case)
        action, force = np.abs(found.plan - expected.plan).max(), _relative(found.forces, expected.forces)
        terms, cost = _relative(found.terms, expected.terms), _relative(found.cost, expected.cost)
        differences.append((action, force, max(terms, cost)))
    most = {"action": MOVE * program.mpc.iterations * program.mpc.learning_rate, "force": FORCE, "cost": COST}
    largest: Figures = dict(zip(most, np.max(differences, axis=0).tolist(), strict=True))
    for figure, allowed in most.items():
        if not largest[figure] <= allowed:  # NaN fails, too
            raise ExportError(
                f"{name} and reference differ by {largest[figure]:.2g} in {figure}; at most {allowed:.2g} is allowed"
            )
    return {"cases": len(differences), **largest}


def _relative(found: Array | float, expected: Array | float) -> float:
    return float(np.abs(np.subtract(found, expected)).max() / max(1.0, np.abs(expected).max()))


def _as_float32(values: Array) -> Array:
    return np.asarray(values, dtype=np.float32).astype(np.float64)


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
) -> Figures:
    """Repeat the control steps of `exact_answers` with a lowering's function, and return figures of the differences. In
    each step, both programs start from the float program's previous plan. Raises ExportError if there are no windows.

    Errors of the commanded action a_t and of all actions of a plan are in U_inf W. The cost gap is J(quantised plan) -
    J(float plan); the float program computes both. The gap is positive if the quantised plan is worse.
    """
    plan, free = np.zeros(program.mpc.horizon), np.ones(program.mpc.horizon)
    weights, errors, gaps = np.array(program.mpc.weights.as_tuple()), list[Array](), list[float]()
    for number, (window, exact) in enumerate(zip(windows, exact_steps, strict=True)):
        asked = _asked(program, number)
        rounded = answer(window, plan, free, *asked)
        start = starting_plan(program, window, plan, free, *asked)
        priced = evaluate(program, encode(program, window), rounded.plan, float(window[-1, -1]), weights, start)
        errors.append(rounded.plan - exact.plan)
        gaps.append(float((priced.terms - exact.terms) @ weights))
        plan = exact.plan
    if not errors:
        raise ExportError("quantisation gate: there are no windows for the comparison")
    error = np.array(errors)
    return {
        "cases": len(errors),
        "max_action_error": float(np.abs(error[:, 0]).max()),
        "rms_action_error": float(np.sqrt((error[:, 0] ** 2).mean())),
        "max_plan_error": float(np.abs(error).max()),
        "max_cost_gap": float(np.max(gaps)),
        "mean_cost_gap": float(np.mean(gaps)),
    }


def _asked(program: ControllerProgram, number: int) -> tuple[Array | None, float, float | None]:
    """Return cost weights, speed and limit for the window with this number; None stands for the program's own value. If
    the program has a prior, those of every second window are in the middle of the prior's range."""
    speed, own = case_speed(program, number), program.mpc.weights
    if program.prior is None or number % 2 == 0:
        return None, speed, None
    halfway = Goal(0.5, 0.5, 0.5)
    effort, lift = (price * own.drag_mean for price in halfway.prices())
    goal = replace(own, effort=effort, lift=lift)
    return np.array(goal.as_tuple()), speed, halfway.share_of_limit() * program.action_limit


def check_quantisation(figures: Figures, limits: Mapping[str, float], *, name: str = "int8 weights") -> None:
    """Raise ExportError if a figure exceeds its limit; the message states lowering and figure."""
    for figure, allowed in limits.items():
        found = figures[figure]
        if not found <= allowed:  # NaN fails, too
            raise ExportError(
                f"{name}: {figure} is {found:.2g}; at most {allowed:.2g} is allowed. "
                "Train longer, or export with --precision float32"
            )
