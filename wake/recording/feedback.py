"""The controller that may close the loop while the wake is recorded; the room has none of its own."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from contract.arrays import Array


class Policy(Protocol):
    """A feedback controller without hidden state: its memory is an array that others store.

    So a recording can be stopped at any step and continued in another process.
    """

    def start(self) -> Array:
        """The memory before the first sample."""

    def step(self, memory: Array, Cp: Array, action: float) -> tuple[float, Array]:
        """The command at t_k and the memory after it, a new array. Raises StillwakeError if there is no answer.

        Args:
            memory: as the step before left it.
            Cp: wall pressures at t_k, (90,).
            action: in force at t_k, a_{k-1} as it acted, in U_inf W.
        """


PolicyFactory = Callable[[], Policy]
"""Makes a policy in the process that records; must be picklable."""


class NoFeedback:
    """Commands nothing."""

    def start(self) -> Array:
        return np.empty(0)

    def step(self, memory: Array, Cp: Array, action: float) -> tuple[float, Array]:
        return 0.0, memory
