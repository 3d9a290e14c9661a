"""The types of arrays. The docstring of each function states the shape, unit and order of its arrays."""

from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]
"""Array of numbers in double precision."""
Precision: TypeAlias = npt.DTypeLike
"""Type of the numbers in a computation: np.float64, or np.float32 for flows simulated to train a controller."""
Index: TypeAlias = npt.NDArray[np.intp]
"""Array of positions in another array, such as the result of `np.argsort`."""
Mask: TypeAlias = npt.NDArray[np.bool_]
"""Array of flags that selects entries of another array."""
MOST_VALUES: Final = 2**27
"""Largest number of values in a file of unknown origin: 1 GiB in double precision. This is enough for 90 sensors over
eight hours with 50 rows per second. A file with more values is refused before it is read."""


def runs(mask: Mask) -> list[tuple[int, int]]:
    """Return the start and the end (exclusive) of every run of consecutive True values."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


class ArrayValue:
    """A frozen dataclass with read-only arrays. Two instances are equal if all their values are equal. Subclasses are
    declared with eq=False, because the `__eq__` that `dataclass` generates cannot compare arrays."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            # A writeable array may belong to the caller, who may change it later, so the array is copied.
            if isinstance(value, np.ndarray) and value.flags.writeable:
                own = value.copy()
                own.flags.writeable = False
                object.__setattr__(self, name, own)

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Unpickling and deep copying give writeable arrays, so the arrays are made read-only here.
        self.__dict__.update(state)
        ArrayValue.__post_init__(self)

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        both = zip(vars(self).values(), vars(other).values(), strict=True)
        return all(np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else a == b for a, b in both)
