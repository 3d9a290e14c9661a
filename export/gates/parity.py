"""The gate between reference and a lowering: the same control steps through both, largest differences, a tolerance.

Tolerances and why: float32 keeps about 7 digits, and a roll-out of 25 steps with layer norms amplifies that to
some 1e-6 in a force of order 1. Adam moves an action by about lr an iteration whatever the gradient's size, so
actions mostly agree to 1e-7; but where a gradient component is near Adam's epsilon, or a kink of |Cl| or max Cd
falls between the two roundings, the move itself differs by some part of lr.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.controller.interface import TERMS, Controller
from contract.errors import ExportError
from contract.runtime.onnx_session import OnnxController
from export.program.controller_program import ControllerProgram
from export.program.windows import random_window
from export.reference.mpc import control_step

SPEEDS: Final = (1.0, 0.6, 1.4)
"""Speeds of the vehicle, as ratios to the design speed, at which cases are judged in turn where the program depends on
it."""
LIMITS: Final = (1.0, 0.8, 0.3, 1.2, 0.55)
"""The same of the bound on |a|, in shares of the program's."""
BEYOND: Final = 100.0
"""The factor by which every fourth case has effort and lift dearer than other cases: a prior was not trained for it."""


@dataclass(frozen=True, kw_only=True)
class ParityTolerance:
    """Largest differences allowed.

    Attributes:
        move: of an action, as a part of iterations * lr, the way Adam can take it; 2.5e-5 U_inf W at the
            paper's setting.
        force: of a predicted Cd or Cl.
        cost: of a term or of J.
    """

    move: float = 5e-3
    force: float = 1e-4
    cost: float = 1e-4


@dataclass(frozen=True, kw_only=True)
class ParityReport:
    """Largest differences between lowering and reference over `cases` control steps; actions in U_inf W."""

    cases: int
    action: float
    force: float
    cost: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlCase:
    """Arguments of one control step, representable in float32 so that both sides see the same numbers."""

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
    """Control steps with random warm starts, up to a quarter of the plan committed, and, in every second one,
    cost weights off their defaults (all terms switched on).

    Args:
        windows: recorded windows (L, S+1), one case each; random ones if None.
        count: cases where `windows` is None.
    """
    rng = np.random.default_rng(seed)
    h, limit = program.mpc.horizon, program.action_limit
    for i in range(count if windows is None else len(windows)):
        window = random_window(program, rng) if windows is None else windows[i]
        free = np.ones(h)
        free[: rng.integers(0, h // 4 + 1)] = 0.0
        weights = rng.uniform(0.5, 2.0, 8) * [1.0, 0.1, 0.05, 0.2, 4.0, 1.0, 4.0, 2.0] if i % 2 else None
        if weights is not None and i % 4 == 3:
            weights[[TERMS.index("effort"), TERMS.index("lift")]] *= BEYOND
        # Just inside the limit, since rounding to float32 may go up.
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
    """The speed that a case is judged at."""
    return float(np.float32(SPEEDS[number % len(SPEEDS)])) if program.knows_speed else 1.0


def check_parity(
    program: ControllerProgram,
    model: bytes,
    windows: Sequence[Array],
    *,
    tolerance: ParityTolerance | None = None,
) -> ParityReport:
    """Run a serialised ONNX controller against the reference; as `check_lowering`."""
    return check_lowering(program, OnnxController(model, program.sizes), "ONNX graph", windows, tolerance=tolerance)


def check_lowering(
    program: ControllerProgram,
    lowering: Controller,
    name: str,
    windows: Sequence[Array],
    *,
    tolerance: ParityTolerance | None = None,
) -> ParityReport:
    """Run a lowering against the reference. Raises ExportError if a difference is above its tolerance or not a number;
    the message names it.

    Args:
        program: what it should compute; for int8 weights, the one that the integers stand for.
        windows: recorded windows (L, S+1), one case each.
    """
    tolerance = ParityTolerance() if tolerance is None else tolerance
    differences = []
    for case in control_cases(program, windows):
        expected = control_step(program, *case.arguments)
        found = lowering.control_step(*case.arguments)
        differences.append(
            (
                np.abs(found.plan - expected.plan).max(),
                np.abs(found.forces - expected.forces).max(),
                max(np.abs(found.terms - expected.terms).max(), abs(found.cost - expected.cost)),
            )
        )
    action, force, cost = (float(value) for value in np.max(differences, axis=0))
    report = ParityReport(cases=len(differences), action=action, force=force, cost=cost)
    for figure, difference, allowed in (
        ("action", action, tolerance.move * program.mpc.iterations * program.mpc.learning_rate),
        ("force", force, tolerance.force),
        ("cost", cost, tolerance.cost),
    ):
        # Written so that a NaN fails.
        if not difference <= allowed:
            raise ExportError(
                f"{name} and reference differ by {difference:.2g} in {figure}, at most {allowed:.2g} is allowed"
            )
    return report


def _as_float32(values: Array) -> Array:
    return np.asarray(values, dtype=np.float32).astype(np.float64)
