"""Vorticity as small whole numbers, for a page that colours it itself and for a run folder that keeps it."""

from typing import Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array

Levels = npt.NDArray[np.int8]
"""(height, width), the first row at the top."""

FIELD_LEVEL: Final = 5.0
"""|vorticity| at the ends of the colours, U_inf / W."""
TOP: Final = 127
"""The level of that vorticity."""


def field_levels(vorticity: Array) -> Levels:
    """(height, width), row 0 at the bottom, to sign(w) (|w| / FIELD_LEVEL)^(1/2) TOP, clipped, row 0 at the top.

    The root shows the far vortices, which are weak.
    """
    # In place and in float32: a third of the time, most of which is for memory.
    squares = np.asarray(vorticity[::-1], dtype=np.float32) * np.float32(TOP**2 / FIELD_LEVEL)
    np.clip(squares, -float(TOP**2), float(TOP**2), out=squares)
    levels = np.abs(squares)
    np.sqrt(levels, out=levels)
    np.copysign(levels, squares, out=levels)
    return np.asarray(np.rint(levels, out=levels), dtype=np.int8)
