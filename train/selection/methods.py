"""The selection methods. `select` takes an encoder, rows and a number of sensors, and returns the chosen names.

A ridge student is a ridge regression of the teacher's latents on delayed readings (lags) of a few sensors. It replaces
the slim encoder where thousands of choices are compared. The fit uses n windows with centred lags X (n, F) and centred
latents Z (n, N_z). The student's weights are

    W = (X'X/n + lambda I)^-1 X'Z/n

The student's error is the unexplained fraction of the latents' mean square in other windows. The products of lags and
latents are computed once for all sensors; a choice of sensors uses a small block.
"""

from collections.abc import Sequence
from itertools import zip_longest
from typing import Final

import numpy as np
import scipy.linalg
import torch

from contract.arrays import Array, Mask
from contract.config.learning import TrainConfig
from contract.errors import ConfigError, DatasetError
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from train.fitting.progress import Phase, Progress, silent
from train.networks.model import Encoder
from train.networks.samples import Rows
from train.selection.shap_ranking import check_count

STRIDE: Final = 4
"""Distance between two lags, in rows: 0.8 t_c. A shedding cycle has about 6 lags, and a window of 32 rows has 8."""
RIDGE: Final = 1e-4
"""Ridge parameter lambda. Inputs have unit variance, so lambda acts like noise of 1 % of a standard deviation."""
FITTED: Final = 4000
JUDGED: Final = 2000
"""Numbers of windows for fit (`FITTED`) and test (`JUDGED`). A smaller number of windows is split in this ratio."""
_CHUNK = 1024


def sample(encoder: Encoder, rows: Rows, seed: int) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the lags of all columns, (n, F x lags), and the encoder's latents, for the windows of the fit and for the
    windows of the test. Raises DatasetError if there are fewer than 6 windows."""
    firsts = rows.first_rows(encoder.window)
    total = min(len(firsts), FITTED + JUDGED)
    if total < 6:
        raise DatasetError(f"the recording has {total} windows: a regression and its test need at least 6")
    drawn = np.random.default_rng(seed).choice(firsts, total, replace=False)
    inputs, latents = [], []
    with torch.no_grad():
        for chunk in np.array_split(drawn, -(-total // _CHUNK)):
            windows = rows.windows_at(chunk, encoder.window)
            latents.append(encoder.encode_segments(windows)[:, 0].cpu().numpy().astype(np.float64))
            # The lags of a column are side by side, newest first.
            lags = windows.cpu().numpy().astype(np.float64)[:, ::-1][:, ::STRIDE]
            inputs.append(lags.transpose(0, 2, 1).reshape(len(chunk), -1))
    x, z = np.concatenate(inputs), np.concatenate(latents)
    fitted = total * FITTED // (FITTED + JUDGED)
    return (x[:fitted], z[:fitted]), (x[fitted:], z[fitted:])


class RidgeStudent:
    """The ridge student of an encoder from windows drawn with `seed`, for sensor noise of the given level. It has the
    products of F lags and N_z latents, as means over windows. Lags and latents are centred on their means over the
    fitted windows. White noise only adds its power to the diagonal of the lags' products, so no noise is drawn. Raises
    DatasetError if there are too few windows, or all their latents are equal.

    Attributes:
        gram, cross: products of the fitted windows' lags with each other (F, F) and with the latents (F, N_z).
        judged_gram, judged_cross: the same products of the test windows.
        judged_power: mean square of the test windows' latents, summed over N_z.
        lags: number of lags of each column.
        noise_power: mean square of the noise on each column; the last entry is for the action.
    """

    def __init__(self, encoder: Encoder, rows: Rows, seed: int, sensor_noise: float = 0.0) -> None:
        (x, z), (judged_x, judged_z) = sample(encoder, rows, seed)
        mean_x, mean_z = x.mean(axis=0), z.mean(axis=0)
        x, z, judged_x, judged_z = x - mean_x, z - mean_z, judged_x - mean_x, judged_z - mean_z
        self.judged_power = float(np.square(judged_z).sum() / len(judged_z))
        if self.judged_power == 0.0:
            raise DatasetError("latents are the same in all windows: no choice of sensors is better than another")
        self.gram, self.cross = x.T @ x / len(x), x.T @ z / len(x)
        self.judged_gram = judged_x.T @ judged_x / len(judged_x)
        self.judged_cross = judged_x.T @ judged_z / len(judged_x)
        self.lags = -(-encoder.window // STRIDE)
        self.noise_power = np.append(np.square(rows.noise(sensor_noise).cpu().numpy().astype(np.float64)), 0.0)

    @property
    def sensors(self) -> int:
        """Number of columns to choose from: all columns except the action."""
        return len(self.noise_power) - 1

    def error(self, chosen: Sequence[int]) -> float:
        """Return the fraction of the test latents' mean square that the chosen sensors and action do not explain."""
        columns = np.append(np.asarray(chosen, dtype=np.intp), self.sensors)
        places = (columns[:, None] * self.lags + np.arange(self.lags)).ravel()
        block = np.ix_(places, places)
        noise = np.diag(self.noise_power[columns].repeat(self.lags))
        regular = self.gram[block] + noise + RIDGE * np.eye(len(places))
        weights = scipy.linalg.cho_solve(scipy.linalg.cho_factor(regular), self.cross[places])
        explained = 2.0 * np.sum(weights * self.judged_cross[places])
        explained -= np.sum(weights * ((self.judged_gram[block] + noise) @ weights))
        return float(1.0 - explained / self.judged_power)


RANDOM_DRAWS: Final = 64


def select_by_hand(count: int, layout: SensorLayout = TRUCK) -> tuple[int, ...]:
    """Return the indices of `count` sensors, outward from the two rear corners, where the shear layers leave the body.

    The order alternates between the next pair along the sides, from the rear forward, and the next pair across the
    base, from its edges inward. When the sides or the base have no more pairs, the remaining pairs follow. On the
    truck, the first four are upper_39, lower_39, base_0 and base_9. Sensors on the symmetry line come last, from the
    rear forward. An odd count may end with only the upper sensor of a pair. Raises ConfigError if the layout has no
    mirror images or no base sensors.
    """
    mirror = layout.mirror
    if mirror is None or not layout.base.size:
        lacking = "mirror images" if mirror is None else "base sensors"
        raise ConfigError(f"train.selection = 'hand' needs {lacking}: use another method or --sensors")
    x, y = layout.positions.T
    on_base = np.isin(np.arange(len(layout)), layout.base)
    paired = mirror != np.arange(len(layout))
    upper = paired & (y > 0)
    both = zip_longest(_sorted(upper & ~on_base, -x), _sorted(upper & on_base, -y))
    pairs = [one for next_two in both for one in next_two if one is not None]
    chosen = [index for one in pairs for index in (one, int(mirror[one]))]
    return tuple([*chosen, *_sorted(~paired, -x)][:count])


def _sorted(wanted: Mask, by: Array) -> list[int]:
    columns = np.flatnonzero(wanted)
    return [int(column) for column in columns[np.argsort(by[columns], kind="stable")]]


def select_qr(rows: Rows, count: int) -> tuple[int, ...]:
    """Return the first `count` pivots of a QR decomposition of the transposed leading POD modes, in order. The aim is
    to reconstruct the pressure field, not the latents. Each pivot is the sensor whose row of the modes has the largest
    norm after its components along the earlier pivots' rows are removed (Manohar, Brunton, Kutz and Brunton,
    "Data-driven sparse sensor placement for reconstruction", IEEE Control Systems Magazine 38, 2018)."""
    pressure = rows.inputs[:, : rows.sensors].cpu().numpy().astype(np.float64)
    pressure -= pressure.mean(axis=0)
    _, vectors = np.linalg.eigh(pressure.T @ pressure)
    # PyPI's python-sensors 0.4 computes these pivots too, but needs scikit-learn, matplotlib and pandas.
    basis = vectors[:, ::-1][:, :count]
    _, order = scipy.linalg.qr(basis.T, mode="r", pivoting=True)
    return tuple(order[:count].tolist())


def select_greedy(student: RidgeStudent, count: int, *, progress: Progress = silent) -> tuple[int, ...]:
    """Choose sensors one after the other; return their indices in this order. Each new sensor reduces the student's
    error most; of equally good sensors the first is chosen."""
    chosen: tuple[int, ...] = ()
    for place in range(count):
        errors = {index: student.error((*chosen, index)) for index in range(student.sensors) if index not in chosen}
        best = min(errors, key=errors.__getitem__)
        chosen = (*chosen, best)
        progress(Phase.SELECT, place + 1, count, {"error": errors[best]})
    return chosen


def draw_choices(count: int, draws: int, seed: int, available: int) -> list[tuple[int, ...]]:
    """Draw random choices of `count` of the available sensors, each without repetition and in the sensors' order."""
    generator = np.random.default_rng(seed)
    return [tuple(np.sort(generator.choice(available, count, replace=False)).tolist()) for _ in range(draws)]


def select_random(
    student: RidgeStudent, count: int, *, draws: int, seed: int, progress: Progress = silent
) -> tuple[int, ...]:
    """Return the random choice with the smallest error of the ridge student."""
    best, least = tuple[int, ...](), np.inf
    for number, chosen in enumerate(draw_choices(count, draws, seed, student.sensors)):
        error = student.error(chosen)
        if error < least:
            best, least = chosen, error
        progress(Phase.SELECT, number + 1, draws, {"error": least})
    return best


def select(encoder: Encoder, rows: Rows, settings: TrainConfig, *, progress: Progress = silent) -> tuple[str, ...]:
    """Return the names of `settings.sensors` sensors in the order of the method `settings.selection`, from rows with
    all sensors' columns.

    "qr": pivots of the pressures' POD modes. "greedy": forward selection with the ridge student. "random": the best of
    `RANDOM_DRAWS` choices according to the ridge student. "hand": by position alone. The ranking for "shap" is in
    `train.selection.shap_ranking`. Raises ConfigError for a number of sensors out of range, or "hand" without mirror
    images or base sensors; DatasetError if `rows` has too few windows.
    """
    method, count = settings.selection, settings.sensors
    check_count(count, rows.sensors)
    if method == "qr":
        chosen = select_qr(rows, count)
    elif method == "hand":
        chosen = select_by_hand(count, rows.layout)
    else:
        # Hashing gives two independent seeds, which also differ between runs with neighbouring seeds.
        windows, choices = np.random.SeedSequence(settings.seed).generate_state(2).tolist()
        student = RidgeStudent(encoder, rows, windows, settings.sensor_noise)
        if method == "greedy":
            chosen = select_greedy(student, count, progress=progress)
        else:
            chosen = select_random(student, count, draws=RANDOM_DRAWS, seed=choices, progress=progress)
    return tuple(rows.layout.names[index] for index in chosen)
