"""Types of the NumPy arrays that pass between functions; each docstring gives shape, unit and order."""

from typing import Any, Final, TypeAlias

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


class ArrayValue:
    """A frozen dataclass whose arrays are read-only, and which equals another one with the same values. It is declared
    with eq=False: what `dataclass` generates cannot compare arrays."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            # A writeable array may belong to the caller, who may change it later.
            if isinstance(value, np.ndarray) and value.flags.writeable:
                own = value.copy()
                own.flags.writeable = False
                object.__setattr__(self, name, own)

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Unpickled and deeply copied arrays are writeable.
        self.__dict__.update(state)
        ArrayValue.__post_init__(self)

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        both = zip(vars(self).values(), vars(other).values(), strict=True)
        return all(np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else a == b for a, b in both)
