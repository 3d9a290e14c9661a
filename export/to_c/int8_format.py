"""The integers of the int8 C library: their ranges, the packing of matrices, and tables of functions. With int8
matrices and int16 activations, a sum of n products is at most 127 qmax(n) n, which is below 2^31. `c_constants` writes
this module's constants into `sw_settings.h`."""

from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.errors import ExportError

_WORD: Final = 4
"""Number of int8 weights in a 32-bit word. A tile of a packed matrix has this number of rows, each of one word."""

INT8_LANES: Final = 2 * _WORD
"""Number of weights in two words. Every length is padded to a multiple of this number. The constants of outputs are
stored in groups of this number of outputs."""

ACTIVATION_MARGIN: Final = 1.5
"""Ratio of the activation at which the integer saturates to the largest activation in the calibration."""

AHEAD: Final = 16
"""Number of zeros after every matrix, because the C code loads weights ahead of their use."""

INT16_QMAX: Final = 32767

SUM_QMAX: Final = (2**31 - 1) // 127
"""Largest sum of a vector's magnitudes for which the product with int8 weights cannot overflow 32 bits."""

FULL_RANGE_WIDTH: Final = SUM_QMAX // INT16_QMAX
"""Largest length of a vector of 16-bit numbers whose product with int8 weights cannot overflow 32 bits."""

XHAT_QMAX: Final = 32767
"""The integer of the largest possible normalised value, which is sqrt(n) in a layer of width n."""

POINTS_PER_UNIT: Final = 32
"""Number of table points per unit of the argument; between points the function is interpolated linearly."""

ELU_ONE: Final = 4096
"""The integer of an ELU output of 1. It is the same in all layers, so they share one table. Outputs up to `ELU_RANGE`
fit into 16 bits."""

ELU_RANGE: Final = 8

ELU_MAX: Final = 6.4
"""Largest output of an ELU that is accepted in the calibration; the rest of `ELU_RANGE` is a margin."""

ELU_ARGUMENT_ONE: Final = 1 << 18
"""The integer of an argument of 1 in the table of ELU."""

ELU_ARGUMENT_MAX: Final = 4000.0
"""Largest argument of an ELU whose integer, in units of 1 / `ELU_ARGUMENT_ONE`, fits in an int32 with one bit in
reserve."""

SLOPE_SHIFT: Final = 4
"""Number of bits by which the integers of ELU slopes are shifted right, so that they can be stored as bytes on the
tape. The integer of a slope of 1 is `ELU_ONE` before the shift and 256 after it."""

GAIN_ONE: Final = 1 << 22
"""The integer of a layer's largest gain, as used in the layer's adjoint. The product of this integer and a slope of 256
is a quarter of the range of an int32."""

ROW_SCALE_ONE: Final = 1 << 23
"""The integer of the largest row scale of a layer's matrix, as used in the layer's adjoint."""

SCALED_BITS: Final = 32
"""Number of fractional bits of the factor in C's sw_scaled. The factor is below 1/2; its integer is the factor times
2^SCALED_BITS."""

LOGISTIC_ONE: Final = 16384
"""The integer of an argument of 1 in the table of the logistic function."""

LOGISTIC_QMAX: Final = 32767
"""The integer of a value of 1 in the table of the logistic function."""

LOGISTIC_RANGE: Final = 16

GATE_MAX: Final = 6e4
"""Largest argument of a gate whose double still fits in an int32, in units of 1 / `LOGISTIC_ONE`."""


def c_constants() -> dict[str, int | np.float32]:
    """Return the definitions of `sw_settings.h` for the int8 sources, except sizes."""
    return {
        "SW_LANES": INT8_LANES,
        "SW_AHEAD": AHEAD,
        "SW_INT16_QMAX": INT16_QMAX,
        "SW_SUM_QMAX": SUM_QMAX,
        "SW_FULL_RANGE_WIDTH": FULL_RANGE_WIDTH,
        "SW_XHAT_QMAX": np.float32(XHAT_QMAX),
        "SW_POINTS_PER_UNIT": POINTS_PER_UNIT,
        "SW_ELU_ONE": ELU_ONE,
        "SW_ELU_RANGE": ELU_RANGE,
        "SW_ELU_ARGUMENT_ONE": ELU_ARGUMENT_ONE,
        "SW_SLOPE_SHIFT": SLOPE_SHIFT,
        "SW_LOGISTIC_ONE": LOGISTIC_ONE,
        "SW_LOGISTIC_RANGE": LOGISTIC_RANGE,
        "SW_LOGISTIC_QMAX": LOGISTIC_QMAX,
    }


def qmax(width: int) -> int:
    """Return the largest integer that a vector of this padded width may have if its product with int8 weights must not
    overflow 32 bits. In C, it is SW_QMAX. Raises ExportError if the vector is so wide that too few integers are left.
    """
    if width > 4 * FULL_RANGE_WIDTH:
        raise ExportError(f"a layer of width {width}: int8 lowering accepts at most {4 * FULL_RANGE_WIDTH}")
    return INT16_QMAX if width <= FULL_RANGE_WIDTH else SUM_QMAX // width


def padded_size(size: int) -> int:
    """Round a length up to a multiple of `INT8_LANES`."""
    return size + -size % INT8_LANES


def packed(values: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """Pack a matrix for `sw_dots` in tiles of 4 x 4 weights. Tiles of the same matrix rows are adjacent; the four
    weights of a row in a tile have the order 0, 2, 1, 3."""
    whole = np.pad(values, [(0, -size % INT8_LANES) for size in values.shape])
    outputs, inputs = whole.shape
    tiles = whole.reshape(outputs // _WORD, _WORD, inputs // _WORD, _WORD)[..., [0, 2, 1, 3]]
    return np.append(tiles.transpose(0, 2, 1, 3).ravel(), np.zeros(AHEAD, np.int8))


def elu_points() -> npt.NDArray[np.uint32]:
    """Return the table of ELU for C's sw_between: points -8, -8 + 1/32, .. below 8, in units of 1 / `ELU_ONE`. The
    values are limited to the largest int16."""

    def elu(x: Array) -> Array:
        held: Array = np.minimum(ELU_ONE * np.where(x < 0, np.expm1(np.minimum(x, 0)), x), INT16_QMAX)
        return held

    return _points(elu, ELU_RANGE)


def logistic_points() -> npt.NDArray[np.uint32]:
    """Return the table of the logistic function for C's sw_between: points -16, -16 + 1/32, .. below 16, in units of 1
    / `LOGISTIC_QMAX`."""
    return _points(lambda x: LOGISTIC_QMAX / (1.0 + np.exp(-x)), LOGISTIC_RANGE)


def _points(function: Callable[[Array], Array], reach: float) -> npt.NDArray[np.uint32]:
    spacing = 1 / POINTS_PER_UNIT
    values = np.rint(function(np.arange(-reach, reach + spacing, spacing))).astype(np.int64)
    return (values[:-1] % (1 << 16) + (np.diff(values) << 16)).astype(np.uint32)
