"""The prior's predictor of pressure differences: an autoregressive model with the action as input (ARX).

    y_{k+1} = sum over i = 0 .. M-1 of  C_i (y_{k-i}, a_{k-i})

In the mirror image of a flow, differences y and actions a change their sign, and so does the output of this linear
model without a constant term. So mirror images would add nothing to a fit.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
import scipy.linalg

from contract.arrays import Array
from contract.errors import DatasetError, StillwakeError
from contract.sensor_layout import SensorLayout

PREDICTOR_RIDGE: Final = 1e-6
"""Ridge of the regression, relative to the mean squares of the regressors."""
_CHUNK: Final = 20_000
"""Number of rows of regressors in memory at a time."""


def check_pairs(layout: SensorLayout, sensors: Sequence[str]) -> None:
    """Check that the sensors are pairs of mirror images, one pair after the other. Raises ConfigError if a name does
    not exist or is given twice; DatasetError if the two sensors of a pair are not mirror images of each other."""
    if layout.mirror is None:
        raise DatasetError("the sensors have no mirror images: a prior reads the differences between mirror images")
    columns = layout.indices(sensors)
    if len(sensors) < 2 or len(sensors) % 2:
        raise DatasetError(f"{len(sensors)} sensors: they must be pairs of mirror images")
    for first, second in zip(columns[::2], columns[1::2], strict=True):
        if layout.mirror[first] != second or first == second:
            raise DatasetError(
                f"sensors {layout.names[first]} and {layout.names[second]} are not a pair: the mirror image of "
                f"{layout.names[first]} is {layout.names[layout.mirror[first]]}"
            )


def predictor(stretches: Sequence[Array], memory: int) -> Array:
    """Fit the coefficients (p, M, p + 1) that predict the next p differences from M rows, oldest first, by ridge
    regression. Raises StillwakeError for fewer steps than coefficients, or a regressor that is always zero.

    Args:
        stretches: arrays of n rows, (n, p + 1) each; row k is (y_k, a_k). A prediction's M rows are from one array.
        memory: M.
    """
    columns = stretches[0].shape[1]
    size = memory * columns
    steps = sum(max(0, len(rows) - memory) for rows in stretches)
    if steps < size:
        raise StillwakeError(f"{steps} control steps to fit {size} coefficients to: at least as many are needed")
    gram, moment = np.zeros((size, size)), np.zeros((size, columns - 1))
    for rows in stretches:
        for start in range(0, max(0, len(rows) - memory), _CHUNK):
            part = rows[start : start + _CHUNK + memory]
            windows = np.lib.stride_tricks.sliding_window_view(part, memory, axis=0)[:-1]
            regressors = windows.transpose(0, 2, 1).reshape(len(windows), -1)
            gram += regressors.T @ regressors
            moment += regressors.T @ part[memory:, :-1]
    scale = np.sqrt(np.diag(gram) / steps)
    if not (scale > 0).all():
        raise StillwakeError(f"column {int(np.flatnonzero(scale == 0)[0]) % columns} of the rows is zero throughout")
    scaled = gram / np.outer(scale, scale) / steps
    solved = scipy.linalg.solve(
        scaled + PREDICTOR_RIDGE * np.eye(size), moment / scale[:, None] / steps, assume_a="pos"
    )
    return np.asarray((solved / scale[:, None]).T).reshape(-1, memory, columns)
