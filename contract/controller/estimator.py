"""What estimates a pressure from the others: the interface of a bundle's `sensors.onnx`, and its network as numbers.

The sensor check of the ECU asks two things of the readings: does each agree with the others, and if not, which one
must be left out, or which two exchanged, so that the rest agree. So one call estimates every pressure from several
views of the same window. With S sensors there are

* S views with one sensor left out,
* S (S - 1) / 2 views with two left out: the rest's estimates of a sensor when another one is suspected too,
* S views for each pair of sensors, in which that pair is exchanged, as if its plugs were, and one sensor is left out.

========= ========  ==================================================================================================
tensor    shape     meaning
========= ========  ==================================================================================================
window    (L, S+1)  as the controller's: oldest row first; row k is (Cp_k, a_{k-1})
estimates (V, S)    of the newest Cp by every view; meant for the sensors that the view leaves out, never built on them
========= ========  ==================================================================================================
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from contract.arrays import Array, Index

ESTIMATOR: Final = "sensors.onnx"
"""The file's name in a bundle."""
ESTIMATOR_INPUT: Final = "window"
ESTIMATOR_OUTPUT: Final = "estimates"
REACH: Final = 16.0
"""Standardised readings are cut off here: sound ones stay within 11 in the shipped recording, and of a broken one no
estimate needs more. In integers the network has the same range."""


class WindowView(NamedTuple):
    """A way to look at a window.

    Attributes:
        left_out: sensors whose columns are not seen.
        exchanged: sensors whose readings change places before that; empty for none.
    """

    left_out: tuple[int, ...]
    exchanged: tuple[int, ...] = ()

    def order(self, sensors: int) -> list[int]:
        """Which column of the window stands where, (S+1,)."""
        columns = list(range(sensors + 1))
        if self.exchanged:
            i, j = self.exchanged
            columns[i], columns[j] = j, i
        return columns


def pairs(sensors: int) -> list[tuple[int, int]]:
    """All pairs of sensors, in order."""
    return list(combinations(range(sensors), 2))


def views(sensors: int) -> list[WindowView]:
    """All V of them, in the order of the rows of `estimates`."""
    single = [WindowView((j,)) for j in range(sensors)]
    double = [WindowView(pair) for pair in pairs(sensors)]
    exchanged = [WindowView((j,), pair) for pair in pairs(sensors) for j in range(sensors)]
    return single + double + exchanged


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypotheses:
    """Where in `estimates` the judgement of each hypothesis stands: one row for each sensor that may lie, then one for
    each pair that may be exchanged.

    Attributes:
        view: (S + P, S) row of `estimates` for each hypothesis and sensor.
        reading: (S + P, S) which reading is compared with it.
    """

    view: Index
    reading: Index

    @classmethod
    def of(cls, sensors: int) -> "Hypotheses":
        """Those for so many sensors."""
        place = {item: row for row, item in enumerate(views(sensors))}
        liars = [
            [place[WindowView((i,) if i == j else (min(i, j), max(i, j)))] for i in range(sensors)]
            for j in range(sensors)
        ]
        swaps = [[place[WindowView((i,), pair)] for i in range(sensors)] for pair in pairs(sensors)]
        own = [list(range(sensors))] * sensors
        crossed = [WindowView((), pair).order(sensors)[:-1] for pair in pairs(sensors)]
        return cls(view=np.array(liars + swaps), reading=np.array(own + crossed))

    def residuals(self, readings: Array, estimates: Array) -> Array:
        """(S + P, S) reading less estimate, in Cp. Row j < S leaves j out of all; its entry j is j by all others."""
        found: Array = readings[self.reading] - estimates[self.view, np.arange(len(readings))]
        return found


def estimator_shapes(window: int, sensors: int) -> Mapping[str, tuple[int, ...]]:
    """The shape of input and output by name."""
    return {ESTIMATOR_INPUT: (window, sensors + 1), ESTIMATOR_OUTPUT: (len(views(sensors)), sensors)}


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatorNetwork:
    """The one network behind all views, fitted by `train.sensor_estimator`.

    Its input is the standardised window within `REACH`, oldest row first, row after row, with the columns of the
    sensors that are left out at zero, and then a flag for every sensor, 1 for those; ReLU between the layers. Its
    output is standardised Cp.

    Attributes:
        window: L.
        mean, std: of the columns of the window, (S+1,).
        layers: (weight (outputs, inputs), bias (outputs,)) of each.
    """

    window: int
    mean: Array
    std: Array
    layers: Sequence[tuple[Array, Array]]

    @property
    def sensors(self) -> int:
        """S."""
        return len(self.mean) - 1

    def estimates(self, window: Array) -> Array:
        """(V, S) for a window (L, S+1), as the graph computes them; (n, V, S) for n windows."""
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
        estimates: Array = values * self.std[:-1] + self.mean[:-1]
        return estimates
