"""An autoregressive model with exogenous input (ARX) by ridge regression: a linear prediction one control step ahead.

    (y_{k+1}, w_{k+1}) = sum over i = 0 .. L-1 of  C_i (y_{k-i}, a_{k-i})

with differences y (p,), responses w (q,) and actions a (Ljung, System Identification, section 4.2). There is no
constant term: see `train.linear.differences`. Coefficients are kept oldest first, (p + q, L, p + 1), as the rows of a
controller's window are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, pi
from typing import Final

import numpy as np
import scipy.linalg

from contract.arrays import Array
from contract.errors import StillwakeError
from train.linear.differences import Series

HORIZONS: Final = (1, 10, 25, 50)
"""Control steps ahead at which predictions are judged; a shedding cycle of the truck has 25."""
_CHUNK: Final = 20_000
"""Regressors that are held at once."""


class IdentificationError(StillwakeError):
    """A recording that no model can be identified from, or a model that makes no sense."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Arx:
    """The model.

    Attributes:
        coefficients: (p + q, L, p + 1), oldest lag first; rows are the differences, then the responses.
        differences: p.
    """

    coefficients: Array
    differences: int

    @property
    def window(self) -> int:
        """L, control steps of memory."""
        return int(self.coefficients.shape[1])

    @property
    def columns(self) -> int:
        """p + 1."""
        return self.differences + 1

    @property
    def flat(self) -> Array:
        """(p + q, L (p + 1)), on a history written row by row, whose last entry is a_k."""
        return self.coefficients.reshape(len(self.coefficients), -1)

    def state_space(self) -> tuple[Array, Array]:
        """A (n, n) and B (n, 1) of x_{k+1} = A x_k + B a_k, with n = L (p + 1) - 1.

        x_k is the history (y_{k-L+1}, a_{k-L+1}, .., y_k) without a_k, which is what is decided.
        """
        size = self.window * self.columns
        moved = np.zeros((size - 1, size))
        kept = size - self.columns
        moved[:kept, self.columns :] = np.eye(kept)
        moved[kept:] = self.flat[: self.differences]
        return moved[:, :-1], moved[:, -1:]


@dataclass(frozen=True, kw_only=True)
class Mode:
    """A mode that grows: by `growth` e-foldings in t_c, at `frequency` in 1/t_c."""

    growth: float
    frequency: float


def fit(series: Sequence[Series], window: int, ridge: float) -> Arx:
    """Ridge regression, with every regressor scaled to a mean square of one. Raises IdentificationError if there are
    fewer steps than coefficients of a row, or a regressor never changes.

    Args:
        window: L.
        ridge: what is added to the scaled regressors' mean squares, 1.
    """
    columns = series[0].rows.shape[1]
    size = window * columns
    steps = sum(max(0, len(item) - window) for item in series)
    if steps < size:
        raise IdentificationError(
            f"{steps} control steps to fit a memory of {window} steps with {size} coefficients to: at least as many "
            f"steps are needed; take more episodes, leave out less of them, or shorten the memory"
        )
    gram = np.zeros((size, size))
    moment = np.zeros((size, columns - 1 + series[0].responses.shape[1]))
    for item in series:
        for start in range(0, max(0, len(item) - window), _CHUNK):
            part = item.part(start, min(len(item), start + _CHUNK + window))
            regressors, targets = regression(part, window)
            gram += regressors.T @ regressors
            moment += regressors.T @ targets
    scale = np.sqrt(np.diag(gram) / steps)
    if not (scale > 0).all():
        column = int(np.flatnonzero(scale == 0)[0]) % columns
        what = "the action" if column == columns - 1 else f"difference {column + 1}"
        raise IdentificationError(f"{what} is zero throughout: nothing can be identified from it")
    scaled = gram / np.outer(scale, scale) / steps
    solved = scipy.linalg.solve(scaled + ridge * np.eye(size), moment / scale[:, None] / steps, assume_a="pos")
    coefficients = (solved / scale[:, None]).T
    return Arx(coefficients=coefficients.reshape(-1, window, columns), differences=columns - 1)


def regression(series: Series, window: int) -> tuple[Array, Array]:
    """Histories (m, L (p + 1)), oldest row first, and what followed, (m, p + q); m = n - L."""
    windows = np.lib.stride_tricks.sliding_window_view(series.rows, window, axis=0)[:-1]
    following = np.column_stack([series.rows[window:, :-1], series.responses[window:]])
    return windows.transpose(0, 2, 1).reshape(len(windows), -1), following


def roll_out_r2(model: Arx, series: Sequence[Series], horizons: Sequence[int] = HORIZONS) -> Array:
    """R2 of predictions over recorded actions, (horizons, p + q), from every fifth step on.

    R2 = 1 - sum (predicted - recorded)^2 / sum (recorded - mean)^2, over all starts. Raises IdentificationError if no
    stretch holds the memory and the longest horizon.
    """
    ahead = max(horizons)
    predicted: list[Array] = []
    recorded: list[Array] = []
    for item in series:
        starts = np.arange(model.window - 1, len(item) - ahead, 5)
        if not len(starts):
            continue
        history = np.stack([item.rows[starts - back] for back in reversed(range(model.window))], axis=1)
        estimates, truth = [], []
        for step in range(1, ahead + 1):
            values = history.reshape(len(starts), -1) @ model.flat.T
            estimates.append(values)
            after = starts + step
            truth.append(np.column_stack([item.rows[after, :-1], item.responses[after]]))
            # The action that was recorded, next to the differences that were predicted.
            row = np.column_stack([values[:, : model.differences], item.rows[after, -1]])
            history = np.concatenate([history[:, 1:], row[:, None]], axis=1)
        predicted.append(np.stack(estimates))
        recorded.append(np.stack(truth))
    if not predicted:
        raise IdentificationError(
            f"held-out stretches of {max(map(len, series))} steps: a memory of {model.window} and {ahead} steps ahead "
            f"need {model.window + ahead}; take longer episodes, or hold out more of them"
        )
    rows = [horizon - 1 for horizon in horizons]
    estimates_, truth_ = np.concatenate(predicted, axis=1)[rows], np.concatenate(recorded, axis=1)[rows]
    squares = ((estimates_ - truth_) ** 2).sum(axis=1)
    spread = ((truth_ - truth_.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    return np.asarray(1.0 - squares / spread)


def growing_modes(model: Arx, period: float) -> tuple[Mode, ...]:
    """The modes of the model without action that grow, fastest first; one of a conjugate pair. `period`
    is that of control, in t_c."""
    values = np.linalg.eigvals(model.state_space()[0])
    growing = [value for value in values if abs(value) > 1.0 and value.imag >= 0.0]
    return tuple(
        Mode(growth=log(abs(value)) / period, frequency=abs(float(np.angle(value))) / (2.0 * pi * period))
        for value in sorted(growing, key=abs, reverse=True)
    )


def refuse_spurious(modes: Sequence[Mode], fastest: float) -> None:
    """Raise IdentificationError if a mode grows faster than a flow of this kind can."""
    if modes and modes[0].growth > fastest:
        worst = modes[0]
        raise IdentificationError(
            f"the model has a mode that grows by {worst.growth:.3g} e-foldings in t_c at {worst.frequency:.3g}/t_c, at "
            f"most {fastest:g} is plausible: take more data or a larger ridge"
        )
