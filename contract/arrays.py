"""Types of the NumPy arrays that pass between functions; each docstring gives shape, unit and order."""

from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]
"""Numbers in double precision."""

Precision: TypeAlias = npt.DTypeLike
"""The type of numbers that is computed with: np.float64, or np.float32 where a flow is trained through."""

Index: TypeAlias = npt.NDArray[np.intp]
"""Positions in another array; `np.arange` and `np.argsort` return such."""

Mask: TypeAlias = npt.NDArray[np.bool_]
"""Which entries of another array are meant."""

MOST_VALUES: Final = 2**27
"""The most values that a file of numbers from anyone may have, 1 GiB in double precision: 90 sensors for eight hours of
a truck's control periods. A file that holds more is refused before it is read."""
