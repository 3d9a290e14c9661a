"""The gate between reference and lowering: both compute the same control steps, and tolerances limit the differences.

The reasons for the tolerances: float32 has about 7 digits, and a roll-out of 25 steps with layer norms amplifies its
rounding to about 1e-6 in a force of order 1. Adam moves an action by about lr per iteration for any size of the
gradient, so most actions agree to 1e-7. But if a gradient component is near Adam's epsilon, or a kink of |Cl| or
max Cd lies between the two rounded values, the moves differ by a part of lr.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.controller.interface import TERMS, Controller
from contract.errors import ExportError
from export.program.controller_program import ControllerProgram
from export.program.windows import random_window
from export.reference.mpc import control_step

SPEEDS: Final = (1.0, 0.6, 1.4)
"""Speeds of the vehicle, as ratios to the design speed; the cases use them in turn if the program depends on the
speed."""
LIMITS: Final = (1.0, 0.8, 0.3, 1.2, 0.55)
"""Bounds on the action's magnitude |a|, as fractions of the controller's bound; the cases use them in turn."""
BEYOND: Final = 100.0
"""Factor on the weights of effort and lift in every fourth case. It puts the goal outside the prior's training
range."""


MOVE: Final = 5e-3
"""Largest allowed difference of an action, as a fraction of Adam's largest move (iterations * learning rate). With the
paper's settings the largest difference is 2.5e-5 U_inf W."""
FORCE: Final = 1e-4
"""Largest allowed difference of a predicted Cd or Cl."""
COST: Final = 1e-4
"""Largest allowed difference of a cost term or of the cost J."""


@dataclass(frozen=True, kw_only=True)
class ParityReport:
    """The largest differences between lowering and reference over `cases` control steps. The difference of actions is
    in U_inf W."""

    cases: int
    action: float
    force: float
    cost: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlCase:
    """The arguments of one control step, representable in float32 so that reference and lowering get equal numbers."""

    window: Array
    plan: Array
    free: Array
    weights: Array | None
    speed: float = 1.0
    limit: float | None = None

    @property
    def arguments(self) -> tuple[Array, Array, Array, Array | None, float, float | None]:
        """The arguments in the order of `Controller.control_step`."""
        return self.window, self.plan, self.free, self.weights, self.speed, self.limit


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


def check_lowering(
    program: ControllerProgram, lowering: Controller, name: str, windows: Sequence[Array]
) -> ParityReport:
    """Compare a lowering with the reference. Raises ExportError if a difference exceeds its tolerance or is NaN.
    `program` is the program that the lowering should compute; for an int8 lowering, it has the dequantised weights.
    `windows` are recorded windows (L, S+1) of L rows and S sensors, one per case."""
    differences = []
    for case in control_cases(program, windows):
        expected = control_step(program, *case.arguments)
        found = lowering.control_step(*case.arguments)
        plan, forces, terms = (
            np.abs(getattr(found, part) - getattr(expected, part)).max() for part in ("plan", "forces", "terms")
        )
        differences.append((plan, forces, max(terms, abs(found.cost - expected.cost))))
    action, force, cost = (float(value) for value in np.max(differences, axis=0))
    report = ParityReport(cases=len(differences), action=action, force=force, cost=cost)
    for figure, difference, allowed in (
        ("action", action, MOVE * program.mpc.iterations * program.mpc.learning_rate),
        ("force", force, FORCE),
        ("cost", cost, COST),
    ):
        # The comparison is written so that NaN fails the gate too.
        if not difference <= allowed:
            raise ExportError(
                f"{name} and reference differ by {difference:.2g} in {figure}, at most {allowed:.2g} is allowed"
            )
    return report


def _as_float32(values: Array) -> Array:
    return np.asarray(values, dtype=np.float32).astype(np.float64)
