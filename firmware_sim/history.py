"""The controller's window of past control periods."""

from collections import deque

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class History:
    """The last L rows (Cp at the sensors, action in force), oldest first."""

    def __init__(self, length: int, sensors: int) -> None:
        self._rows: deque[Array] = deque(maxlen=length)
        self._sensors = sensors

    @property
    def is_full(self) -> bool:
        return len(self._rows) == self._rows.maxlen

    def append(self, cp: Array, action: float) -> None:
        """Add a period; cp is (S,)."""
        self._rows.append(np.append(cp, action))

    def repeat_last(self, action: float) -> None:
        """Stand in for a period without pressures: the last ones again. Nothing happens before the first row."""
        if self._rows:
            self.append(self._rows[-1][: self._sensors], action)

    def window(self) -> Array:
        """(L, S + 1); only meaningful when full."""
        return np.array(self._rows)
