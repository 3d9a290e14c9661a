"""The rows that a linear controller and a prior read: differences of the sensors' pairs, and the action."""

import numpy as np

from contract.arrays import Array


def history_of(window: Array) -> Array:
    """Rows (y_k, a_k), (L, p + 1), of a window of rows (Cp_k, a_{k-1}); the last action is 0, as it is not decided."""
    y = window[:, :-1:2] - window[:, 1:-1:2]
    return np.column_stack([y, np.append(window[1:, -1], 0.0)])
