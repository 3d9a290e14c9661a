"""The interface and weights of a bundle's `sensors.onnx`, which estimates each pressure from the other pressures.

The ECU's sensor check compares each reading with the other readings. If the readings disagree, the check searches for a
sensor to leave out, or for two sensors to exchange, so that the readings agree. For this search, one call estimates
every pressure from several views of a window. With S sensors there are

* S views with one sensor left out,
* S (S - 1) / 2 views with two sensors left out, to estimate one sensor while another sensor is suspected,
* S views for each pair of sensors, in which the pair's readings are exchanged and one sensor is left out.

========= ========  ==================================================================================================
tensor    shape     meaning
========= ========  ==================================================================================================
window    (L, S+1)  the controller's window: oldest row first; row k is (Cp_k, a_{k-1})
estimates (V, S)    the newest Cp as estimated by every view; valid for the sensors that the view leaves out
========= ========  ==================================================================================================
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from contract.arrays import Array, Index

ESTIMATOR: Final = "sensors.onnx"
"""Name of the estimator's file in a bundle."""
ESTIMATOR_INPUT: Final = "window"
ESTIMATOR_OUTPUT: Final = "estimates"
REACH: Final = 16.0
"""Limit to which standardised readings are clipped. Healthy sensors stay within 11 in the shipped recording, so
clipping usually changes only readings of faulty sensors. The estimator in integer arithmetic has the same limit."""


class WindowView(NamedTuple):
    """A selection of a window's columns as input of the estimator. The columns of the sensors in `left_out` are not
    used. `exchanged` is empty, or a pair of sensors whose readings are exchanged before columns are left out."""

    left_out: tuple[int, ...]
    exchanged: tuple[int, ...] = ()

    def order(self, sensors: int) -> list[int]:
        """Return the order of the window's columns in this view, (S+1,) for S sensors and the action."""
        columns = list(range(sensors + 1))
        if self.exchanged:
            i, j = self.exchanged
            columns[i], columns[j] = j, i
        return columns


def pairs(sensors: int) -> list[tuple[int, int]]:
    """Return all pairs of different sensors (i, j), i < j, in ascending order."""
    return list(combinations(range(sensors), 2))


def views(sensors: int) -> list[WindowView]:
    """Return all V views, in the order of the rows of `estimates`."""
    single = [WindowView((j,)) for j in range(sensors)]
    double = [WindowView(pair) for pair in pairs(sensors)]
    return single + double + [WindowView((j,), pair) for pair in pairs(sensors) for j in range(sensors)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypotheses:
    """The rows of `estimates` that belong to each hypothesis. A hypothesis states that one of the S sensors reads
    wrongly, or that one of the P pairs of sensors is exchanged. `view` has the row of `estimates` for each hypothesis
    and sensor, (S + P, S). `reading` has the index of the reading that is compared with each of these estimates."""

    view: Index
    reading: Index

    @classmethod
    def of(cls, sensors: int) -> "Hypotheses":
        """Build the hypotheses for a number of sensors."""
        place = {item: row for row, item in enumerate(views(sensors))}
        every = range(sensors)
        liars = [[place[WindowView(tuple(sorted({i, j})))] for i in every] for j in every]
        swaps = [[place[WindowView((i,), pair)] for i in every] for pair in pairs(sensors)]
        own = [list(every)] * sensors
        crossed = [WindowView((), pair).order(sensors)[:-1] for pair in pairs(sensors)]
        return cls(view=np.array(liars + swaps), reading=np.array(own + crossed))

    def residuals(self, readings: Array, estimates: Array) -> Array:
        """Return the residuals (S + P, S), reading minus estimate, in Cp. The estimates of row j < S do not use sensor
        j. Entry j of this row is the residual of sensor j, estimated from all other sensors."""
        return np.asarray(readings[self.reading] - estimates[self.view, np.arange(len(readings))])


def estimator_shapes(window: int, sensors: int) -> Mapping[str, tuple[int, ...]]:
    """Return the shapes of input and output by name."""
    return {ESTIMATOR_INPUT: (window, sensors + 1), ESTIMATOR_OUTPUT: (len(views(sensors)), sensors)}


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatorNetwork:
    """The network that computes the estimates of all views. `train.sensor_estimator` fits this network.

    Its input has two parts. The first part is the standardised window of L rows, clipped to `REACH`, with the oldest
    row first; the columns of sensors that are left out are zero. The second part is a flag for every sensor, 1 if the
    sensor is left out. The hidden layers have ReLU. The output is standardised Cp. `mean` and `std` are those of the
    window's columns, (S+1,). Each of the `layers` has a weight (outputs, inputs) and a bias (outputs,).
    """

    window: int
    mean: Array
    std: Array
    layers: Sequence[tuple[Array, Array]]

    @property
    def sensors(self) -> int:
        return len(self.mean) - 1

    def estimates(self, window: Array) -> Array:
        """Compute the estimates that the graph returns: (V, S) for one window (L, S+1), or (n, V, S) for n windows."""
        sensors, rows = self.sensors, []
        for view in views(sensors):
            seen = np.ones(sensors + 1)
            seen[list(view.left_out)] = 0.0
            scaled = np.clip((window[..., view.order(sensors)] - self.mean) / self.std, -REACH, REACH) * seen
            hidden = np.broadcast_to(1.0 - seen[:-1], (*window.shape[:-2], sensors))
            rows.append(np.concatenate([scaled.reshape(*hidden.shape[:-1], -1), hidden], axis=-1))
        values = np.stack(rows, axis=-2)
        for number, (weight, bias) in enumerate(self.layers):
            values = (np.maximum(values, 0.0) if number else values) @ weight.T + bias
        return np.asarray(values * self.std[:-1] + self.mean[:-1])
