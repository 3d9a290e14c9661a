"""The controller's window of past control periods."""

from collections import deque

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class History:
    """The last L rows (Cp at the sensors, action in force), oldest first, one for every control period.

    Args:
        length: L.
        bridge: periods in a row without pressures that may be made up; a longer gap empties the window, so that
            the controller never plans from pressures long past.
    """

    def __init__(self, length: int, bridge: int) -> None:
        self._rows: deque[Array] = deque(maxlen=length)
        self._bridge = bridge
        self._made_up = 0

    @property
    def is_full(self) -> bool:
        return len(self._rows) == self._rows.maxlen

    def append(self, cp: Array, action: float) -> None:
        """Add a period; cp is (S,)."""
        self._rows.append(np.append(cp, action))
        self._made_up = 0

    def repeat_last(self, action: float) -> None:
        """Stand in for a period without pressures: the last ones again. Nothing happens before the first row."""
        self._made_up += 1
        if self._made_up > self._bridge:
            self._rows.clear()
        if self._rows:
            self._rows.append(np.append(self._rows[-1][:-1], action))

    def window(self) -> Array:
        """(L, S + 1); only meaningful when full."""
        return np.array(self._rows)
