"""Measured series as 16-bit integers: value = integer * quantum, as a 16-bit sensor would give them.

The quantum is a power of two, so that reading is exact and writing what was read changes nothing.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array

LARGEST: Final = 32767
"""Largest integer; its negative is the smallest, so that a series and its mirror image are stored alike."""


def pack(values: Array, finest: float, coarsest: float) -> tuple[npt.NDArray[np.int16], float]:
    """Integers and their quantum: the finest power of two that holds every value, and not below `finest`. Raises
    ValueError if a value lies outside +-32767 * coarsest; nothing is clipped and nothing wraps around.

    Args:
        values: finite, any shape.
        finest: quantum of a series that stays within +-32767 of them.
        coarsest: quantum that is never exceeded; `finest` times a power of two.
    """
    quantum, peak = finest, float(np.abs(values).max(initial=0.0))
    while np.rint(peak / quantum) > LARGEST:
        quantum *= 2.0
        if quantum > coarsest:
            raise ValueError(f"holds {peak:g}, more than {LARGEST * coarsest:g} in magnitude")
    return np.rint(values / quantum).astype(np.int16), quantum


def unpack(integers: npt.NDArray[np.int16], quantum: float) -> Array:
    """The values, each within half a quantum of what was packed."""
    return integers.astype(np.float64) * quantum
