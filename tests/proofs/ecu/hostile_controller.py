"""A controller that does wrong on request."""

from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.controller.interface import FORCES, ControllerError, ControlStep

GOOD: Final = ("swing", "small", "huge")
"""Finite plans: from limit to limit and beyond, calm, and of 10^300 where a flow rate is still a number."""
BAD: Final = ("nan", "inf", "overflow", "raise", "memory", "none", "short", "flat", "object", "forces", "write")
"""No answer, or none that may drive a jet."""


class HostileController:
    """Does what it was prepared for; `called` tells whether a step was asked for since then."""

    def __init__(self) -> None:
        self._kept: list[Array] = []
        self.prepare("small", 0.0)

    def prepare(self, deed: str, value: float) -> None:
        """For the next step: one of `GOOD` or `BAD`, and the action that is planned, in U_inf W."""
        self._deed, self._value, self.called = deed, value, False

    def control_step(self, window: Array, plan: Array, *given: Any, **named: Any) -> ControlStep:
        """See `Controller`; it also spoils what it was given to read and write, and what it gave back before."""
        self.called, deed = True, self._deed
        for array in self._kept:
            array[...] = np.nan
        if deed in ("raise", "memory"):
            raise ControllerError("no answer") if deed == "raise" else MemoryError
        huge = 1e300 if self._value > 0 else -1e300
        level = {"small": 0.2 * self._value, "huge": huge, "nan": np.nan, "inf": np.inf, "overflow": 1.7e308}
        values, forces = np.full(len(plan), level.get(deed, self._value)), np.zeros((len(plan), FORCES))
        wrong = {"short": values[:-1], "flat": np.zeros((len(plan), 2)), "object": values.astype(object)}
        answer: Any = ControlStep(plan=wrong.get(deed, values), forces=forces, terms=np.zeros(8), cost=0.0)
        plan[:] = 7.0
        if deed == "forces":
            forces[-1, -1] = np.nan
        if deed == "write":
            window.fill(0.0)  # read-only
        self._kept = [values, forces]
        return answer if deed != "none" else None  # type: ignore[return-value]
