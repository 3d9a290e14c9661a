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
    """Does what it was prepared for.

    Attributes:
        called: a step was asked for since then.
    """

    def __init__(self) -> None:
        self._kept: list[Array] = []
        self.prepare("small", 0.0)

    def prepare(self, deed: str, value: float) -> None:
        """For the next step: one of `GOOD` or `BAD`, and the action that is planned, in U_inf W."""
        self._deed, self._value, self.called = deed, value, False

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> ControlStep:
        """See `Controller`; it also spoils what it was given to read and write, and what it gave back before."""
        self.called = True
        for array in self._kept:
            array[...] = np.nan
        values = np.full(len(plan), (0.2 if self._deed == "small" else 1.0) * self._value)
        forces = np.zeros((len(plan), FORCES))
        answer: Any = ControlStep(plan=values, forces=forces, terms=np.zeros(7), cost=0.0)
        plan[:] = 7.0
        deed = self._deed
        if deed == "huge":
            values[:] = 1e300 if self._value > 0 else -1e300
        elif deed in ("nan", "inf"):
            values[:] = np.nan if deed == "nan" else np.inf
        elif deed == "overflow":
            values[:] = 1.7e308
        elif deed == "forces":
            forces[-1, -1] = np.nan
        elif deed in ("raise", "memory"):
            raise (ControllerError("no answer") if deed == "raise" else MemoryError())
        elif deed == "none":
            return None  # type: ignore[return-value]
        elif deed in ("short", "flat", "object"):
            wrong = {"short": values[:-1], "flat": np.zeros((len(plan), 2)), "object": values.astype(object)}[deed]
            answer = ControlStep(plan=wrong, forces=forces, terms=np.zeros(7), cost=0.0)
        elif deed == "write":
            window.fill(0.0)  # read-only
        self._kept = [values, forces]
        return answer
