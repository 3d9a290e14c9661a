"""The preparation of a sensor estimator for a bundle: the network is rounded and lowered, its residuals measured."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from contract.arrays import Array
from contract.controller.estimator import EstimatorNetwork, Hypotheses
from contract.recording.dataset import Dataset
from contract.release.bundle import MadeEstimator
from contract.release.manifest import FAST_PERIODS, SLOW_PERIODS, SensorEstimator
from export.int8 import rounded_estimator
from export.to_onnx.sensor_estimator import build_estimator


def lowered_estimator(
    fitted: EstimatorNetwork, recording: Dataset, sensors: Sequence[str], provenance: Mapping[str, Any]
) -> MadeEstimator:
    """Return the estimator of these sensors for a bundle, with the root mean squares of its residuals. As in the sensor
    check, the residuals are first averaged over time. The residuals come from the episodes that were not used for
    training or, if there are none, from the training episodes. The provenance gets two more entries: `r2`, the
    coefficient of determination of each sensor's estimate from the other sensors, and `judged_on`, the roles of the
    measured episodes."""
    rounded = rounded_estimator(fitted)
    network, window, columns = rounded.network, fitted.window, recording.layout.indices(sensors)
    unseen = [item for item in recording.episodes if item.role != "train" and len(item) > window + SLOW_PERIODS]
    used = unseen or [item for item in recording.with_role("train") if len(item) > window]
    judged = [item.rows(columns) for item in used]
    residuals = [_residuals(network, rows) for rows in judged]
    alone = np.concatenate([np.einsum("nii->ni", item) for item in residuals])
    spread = np.concatenate([rows[window - 1 :, :-1] for rows in judged]).var(axis=0)
    r2 = 1.0 - np.square(alone).mean(axis=0) / spread
    measured = {"judged_on": tuple(sorted({item.role for item in used}))}
    return MadeEstimator(
        graph=build_estimator(rounded).SerializeToString(),
        figures=SensorEstimator(fast=_deviation(residuals, FAST_PERIODS), slow=_deviation(residuals, SLOW_PERIODS)),
        provenance={**provenance, **measured, "r2": dict(zip(sensors, r2.tolist(), strict=True))},
    )


def _residuals(network: EstimatorNetwork, rows: Array) -> Array:
    """Compute residuals (n - L + 1, S, S): [., j, i] is the one of sensor i, estimated without the sensors j and i."""
    hypotheses = Hypotheses.of(network.sensors)
    windows = np.lib.stride_tricks.sliding_window_view(rows, network.window, axis=0).transpose(0, 2, 1)
    found = [hypotheses.residuals(window[-1, :-1], network.estimates(window)) for window in windows]
    return np.array(found)[:, : network.sensors]


def _deviation(residuals: Sequence[Array], periods: int) -> tuple[tuple[float, ...], ...]:
    """Compute the root mean squares, (S, S), of the residuals' running means over `periods` periods."""
    squares = []
    for item in residuals:
        mean = np.zeros(item.shape[1:])
        for number, value in enumerate(item):
            mean = mean + (value - mean) / periods
            if number >= periods or len(item) <= periods:
                squares.append(np.square(mean))
    return tuple(tuple(row) for row in np.sqrt(np.mean(squares, axis=0)).tolist())
