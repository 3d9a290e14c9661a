"""A student that is fitted in milliseconds: ridge regression of the teacher's latents on lags of a few sensors.

The student replaces the slim encoder where thousands of choices are compared and not all can be distilled. The fit uses
n windows with centred lags X (n, F) and centred latents Z (n, N_z). The student's weights are

    W = (X'X/n + lambda I)^-1 X'Z/n

The student's error is the unexplained fraction of the latents of other windows. Weights and error need only the
products of all lags, which are computed once; the error of a choice needs only a small block of these products.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg
import torch
from torch import Tensor

from contract.arrays import Array, Index
from contract.errors import DatasetError
from train.networks.model import Encoder
from train.samples.rows import Rows


def first_rows(rows: Rows, window: int) -> Index:
    """Return the index of the first row of every full window."""
    return np.concatenate([np.arange(span.start, span.stop - window + 1) for span in rows.spans()])


def windows_at(rows: Rows, firsts: Index, window: int) -> Tensor:
    """Return the n windows that begin at the given n rows, (n, L, F)."""
    start = torch.as_tensor(firsts, device=rows.inputs.device)
    return rows.inputs[start[:, None] + torch.arange(window, device=start.device)]


STRIDE: Final = 4
"""Distance between two lags, in rows: 0.8 t_c. A shedding cycle has about six lags, a window of 32 rows has 8."""

RIDGE: Final = 1e-4
"""Ridge parameter lambda. Inputs have unit variance, so lambda acts like noise of 1 % of a standard deviation."""

FITTED: Final = 4000
JUDGED: Final = 2000
"""Numbers of windows for the fit (`FITTED`) and the test (`JUDGED`); fewer windows are split in this ratio."""

_CHUNK = 1024


def sample(encoder: Encoder, rows: Rows, seed: int) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the lags of all columns, (n, F x lags), and the encoder's latents, for the windows of the fit and for the
    windows of the test. Raises DatasetError if there are fewer than 6 windows."""
    firsts = first_rows(rows, encoder.window)
    total = min(len(firsts), FITTED + JUDGED)
    if total < 6:
        raise DatasetError(f"recording has {total} windows, too few to fit and judge a student: must be at least 6")
    drawn = np.random.default_rng(seed).choice(firsts, total, replace=False)
    inputs, latents = [], []
    with torch.no_grad():
        for chunk in np.array_split(drawn, -(-total // _CHUNK)):
            windows = windows_at(rows, chunk, encoder.window)
            latents.append(encoder.encode_segments(windows)[:, 0].cpu().numpy().astype(np.float64))
            # The lags of a column are side by side, newest first.
            lags = windows.cpu().numpy().astype(np.float64)[:, ::-1][:, ::STRIDE]
            inputs.append(lags.transpose(0, 2, 1).reshape(len(chunk), -1))
    x, z = np.concatenate(inputs), np.concatenate(latents)
    fitted = total * FITTED // (FITTED + JUDGED)
    return (x[:fitted], z[:fitted]), (x[fitted:], z[fitted:])


@dataclass(frozen=True, kw_only=True, eq=False)
class RidgeStudent:
    """The products of F lags and N_z latents, as means over windows. Lags and latents are centred on their means over
    the fitted windows.

    Attributes:
        gram, cross: products of the fitted windows' lags with each other (F, F) and with the latents (F, N_z).
        judged_gram, judged_cross: the same products of the test windows.
        judged_power: mean square of the test windows' latents, summed over N_z.
        lags: number of lags of each column.
        noise_power: mean square of the noise on each column; the last entry is for the action.
    """

    gram: Array
    cross: Array
    judged_gram: Array
    judged_cross: Array
    judged_power: float
    lags: int
    noise_power: Array

    @property
    def sensors(self) -> int:
        """Number of columns to choose from: all except the column of the action."""
        return len(self.noise_power) - 1

    def error(self, chosen: Sequence[int]) -> float:
        """Return the fraction of the test latents' mean square that chosen sensors and action do not explain."""
        columns = np.append(np.asarray(chosen, dtype=np.intp), self.sensors)
        places = (columns[:, None] * self.lags + np.arange(self.lags)).ravel()
        block = np.ix_(places, places)
        noise = np.diag(self.noise_power[columns].repeat(self.lags))
        regular = self.gram[block] + noise + RIDGE * np.eye(len(places))
        weights = scipy.linalg.cho_solve(scipy.linalg.cho_factor(regular), self.cross[places])
        explained = 2.0 * np.sum(weights * self.judged_cross[places])
        explained -= np.sum(weights * ((self.judged_gram[block] + noise) @ weights))
        return float(1.0 - explained / self.judged_power)


def ridge_student(encoder: Encoder, rows: Rows, seed: int, sensor_noise: float = 0.0) -> RidgeStudent:
    """Compute the student of an encoder, with windows drawn by `seed` and with sensor noise of the given level. White
    noise only adds its power to the diagonal of the lags' products, so no noise is drawn. Raises DatasetError if there
    are too few windows, or all their latents are equal."""
    (x, z), (judged_x, judged_z) = sample(encoder, rows, seed)
    mean_x, mean_z = x.mean(axis=0), z.mean(axis=0)
    x, z, judged_x, judged_z = x - mean_x, z - mean_z, judged_x - mean_x, judged_z - mean_z
    power = float(np.square(judged_z).sum() / len(judged_z))
    if power == 0.0:
        raise DatasetError("latents are the same in all windows: no choice of sensors is better than another")
    return RidgeStudent(
        gram=x.T @ x / len(x),
        cross=x.T @ z / len(x),
        judged_gram=judged_x.T @ judged_x / len(judged_x),
        judged_cross=judged_x.T @ judged_z / len(judged_x),
        judged_power=power,
        lags=-(-encoder.window // STRIDE),
        noise_power=np.append(np.square(rows.noise(sensor_noise).cpu().numpy().astype(np.float64)), 0.0),
    )
