"""The terms from which the air speed is estimated in the controlled wake.

The speed on the bus is usually the speed over the ground, so it lacks the wind. With a wrong speed, pressures and
actions are scaled wrongly and rows have wrong distances in time, which changes the products of pressures and actions. A
weighted sum of the means of such products under control estimates the logarithm of the ratio of the speed in use to the
air speed. The weights are fitted to runs of the release's prior with wrong speeds (`train.refinement.air_speed`).
"""

from typing import Final

import numpy as np

from contract.arrays import Array

LAGS: Final = (1, 3, 6)
"""Distances in rows between the factors of a product. Noise would raise the mean of a square, but not this mean."""
MEAN_PERIODS: Final = 50
"""Number of periods of the running means of the features: two shedding cycles."""
FIRST_PERIOD: Final = 100
"""Number of controlled periods before the first estimate, so that the wake resembles the wakes used for the fit."""


def feature_count(pairs: int) -> int:
    """Return F, the number of features for p pairs of mirrored sensors."""
    return pairs + len(LAGS) * (pairs + 1) ** 2


def weight_count(pairs: int) -> int:
    """Return the number of terms for p pairs of mirrored sensors. Each term has one weight."""
    return feature_count(pairs) + pairs + 1


def features(window: Array) -> Array:
    """Compute the features (..., F) of the last row of a window (..., L, 2 p + 1). A row has the Cp of p pairs of
    mirrored sensors, pair by pair, and the action, all scaled with the speed in use. Its signals are the pairs'
    differences and the action. The features are the last row's sums of pairs, and for each lag in `LAGS` all products
    of a signal of the last row and a signal of the row `lag` rows earlier."""
    one, other = window[..., 0:-1:2], window[..., 1:-1:2]
    signals = np.concatenate([one - other, window[..., -1:]], axis=-1)
    newest, sums = signals[..., -1, :, None], (one + other)[..., -1, :]
    products = (newest * signals[..., -1 - lag, None, :] for lag in LAGS)
    return np.concatenate([sums, *(each.reshape(*sums.shape[:-1], -1) for each in products)], axis=-1)


def terms(means: Array, pairs: int) -> Array:
    """Return the terms of the estimate from the features' means (..., F): the means, the first p squares, and 1."""
    return np.concatenate([means, np.square(means[..., :pairs]), np.ones((*means.shape[:-1], 1))], axis=-1)
