"""Rounding to float32, the precision of every lowering except the reference."""

import numpy as np
import numpy.typing as npt

from contract.errors import ExportError


def as_float32(values: npt.ArrayLike, name: str) -> npt.NDArray[np.float32]:
    """Round values to float32. Raises ExportError, whose message states the name, if a value has no finite float32."""
    with np.errstate(over="ignore"):
        array = np.asarray(values, dtype=np.float64).astype(np.float32)
    if not np.isfinite(array).all():
        raise ExportError(f"{name}: a value is too large for float32")
    return array


def float32_within(limit: float) -> float:
    """Return the largest float32 that is not above the limit. With this value as the limit, rounding moves no action
    out of bounds."""
    rounded = np.float32(limit)
    return float(np.nextafter(rounded, np.float32(0.0)) if float(rounded) > limit else rounded)
