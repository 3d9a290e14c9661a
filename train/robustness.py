"""What the model says when its sensors do not tell the truth, and where along a recording it errs (paper, appendices
A and B; bias, drift and dead sensors are what the paper leaves open).

Every fault is a function from rows to rows. Sensors are disturbed in units of the global deviation
(`train.scaling.global_deviation`), so that one level means the same pressure everywhere.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from contract.arrays import Array
from contract.errors import ConfigError
from train.rows import Rows

Fault = Callable[[Rows], Rows]


def noise(level: float, unit: Array, seed: int) -> Fault:
    """White Gaussian noise of `level` global deviations on every sensor, independent.

    Args:
        unit: (N,) from `train.scaling.unit_steps`, for the N sensors of the rows it is applied to.
    """
    if level < 0:
        raise ConfigError(f"noise level {level}: must be non-negative")

    def fault(rows: Rows) -> Rows:
        draw = np.random.default_rng(seed).standard_normal((len(rows.inputs), len(unit)))
        return _added(rows, level * draw * unit)

    return fault


def bias(level: float, unit: Array, sensor: int) -> Fault:
    """A constant `level` global deviations on one sensor, given by its place among the rows' columns."""
    step = np.zeros(len(unit))
    step[sensor] = level * unit[sensor]
    return lambda rows: _added(rows, np.broadcast_to(step, (len(rows.inputs), len(unit))))


def drift(level: float, unit: Array, sensor: int) -> Fault:
    """A bias on one sensor that grows evenly from 0 to `level` global deviations over each episode."""

    def fault(rows: Rows) -> Rows:
        change = np.zeros((len(rows.inputs), len(unit)))
        for span in rows.spans():
            change[span, sensor] = np.linspace(0.0, level * unit[sensor], span.stop - span.start)
        return _added(rows, change)

    return fault


def dead(sensor: int) -> Fault:
    """One sensor says what it said in each episode's first row, for ever."""

    def fault(rows: Rows) -> Rows:
        inputs = rows.inputs.clone()
        for span in rows.spans():
            inputs[span, sensor] = inputs[span.start, sensor]
        return replace(rows, inputs=inputs)

    return fault


def sliding_error(decoded: Tensor, reference: Tensor, width: int) -> Tensor:
    """L1/sigma within each run of `width` consecutive samples, (n - width + 1, 2) of (n, 2) forces.

    Sigma is that of the whole reference, as in the paper's figure: a local one would be small where the wake is calm.

    Raises:
        ConfigError: if there are fewer samples than `width`.
    """
    if not 1 <= width <= len(reference):
        raise ConfigError(f"sliding window of {width} samples: must be from 1 to the {len(reference)} there are")
    error = (decoded - reference).abs().double()
    running = torch.cat([error.new_zeros(1, 2), error.cumsum(dim=0)])
    return (running[width:] - running[:-width]) / width / reference.double().std(dim=0, correction=0)


def _added(rows: Rows, change: Array) -> Rows:
    inputs = rows.inputs.clone()
    inputs[:, : change.shape[1]] += torch.from_numpy(change).to(inputs)
    return replace(rows, inputs=inputs)
