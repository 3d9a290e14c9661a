"""The selection methods: each takes an encoder, rows and a number of sensors, and returns the sensors' names."""

from itertools import zip_longest
from typing import Final, get_args

import numpy as np
import scipy.linalg

from contract.arrays import Array, Mask
from contract.config.learning import SelectionMethod, TrainConfig
from contract.errors import ConfigError
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from train.fitting.progress import Phase, Progress, silent
from train.networks.model import Encoder
from train.samples.rows import Rows
from train.selection.ranking import check_count
from train.selection.ridge_student import RidgeStudent, ridge_student
from train.selection.shap_ranking import ShapRanker, rank

METHODS: Final[tuple[SelectionMethod, ...]] = get_args(SelectionMethod)
RANDOM_DRAWS: Final = 64
"""Number of random choices that "random" compares."""


def select_by_hand(count: int, layout: SensorLayout = TRUCK) -> tuple[int, ...]:
    """Return the indices of `count` sensors, outward from the two rear corners, where the shear layers leave the body.

    The order alternates between the next pair along the sides, from the rear forward, and the next pair across the
    base, from its edges inward. When the sides or the base have no more pairs, the remaining pairs follow. On the
    truck, the first four are upper_39, lower_39, base_0 and base_9. Sensors on the symmetry line come last, from the
    rear forward. An odd count may end with only the upper sensor of a pair. Raises ConfigError without mirror images or
    base sensors.
    """
    mirror = layout.mirror
    if mirror is None or not layout.base.size:
        lacking = "mirror images" if mirror is None else "base"
        raise ConfigError(f"train.selection = 'hand': these sensors have no {lacking}; use another method or --sensors")
    x, y = layout.positions.T
    on_base = np.isin(np.arange(len(layout)), layout.base)
    paired = mirror != np.arange(len(layout))
    upper = paired & (y > 0)
    sides = _sorted(upper & ~on_base, -x)
    base = _sorted(upper & on_base, -y)
    pairs = [one for both in zip_longest(sides, base) for one in both if one is not None]
    chosen = [index for one in pairs for index in (one, int(mirror[one]))]
    return tuple([*chosen, *_sorted(~paired, -x)][:count])


def _sorted(wanted: Mask, by: Array) -> list[int]:
    """Return the columns that are `wanted`, in rising order of their values in `by`."""
    columns = np.flatnonzero(wanted)
    return [int(column) for column in columns[np.argsort(by[columns], kind="stable")]]


def select_qr(rows: Rows, count: int) -> tuple[int, ...]:
    """Return the indices of the first `count` pivots of a QR decomposition of the transposed leading POD modes, in
    order. These sensors are chosen to reconstruct the pressure field, not the latents: each pivot is the sensor whose
    row of the modes is longest after the components along the earlier pivots are removed (Manohar, Brunton, Kutz and
    Brunton, "Data-driven sparse sensor placement for reconstruction", IEEE Control Systems Magazine 38, 2018)."""
    pressure = rows.inputs[:, : rows.sensors].cpu().numpy().astype(np.float64)
    pressure -= pressure.mean(axis=0)
    _, vectors = np.linalg.eigh(pressure.T @ pressure)
    # PyPI's python-sensors 0.4 computes these pivots too, but needs scikit-learn, matplotlib and pandas.
    basis = vectors[:, ::-1][:, :count]
    _, order = scipy.linalg.qr(basis.T, mode="r", pivoting=True)
    return tuple(order[:count].tolist())


def select_greedy(student: RidgeStudent, count: int, *, progress: Progress = silent) -> tuple[int, ...]:
    """Return the indices of sensors that are chosen one after the other, in this order. Each choice reduces the
    student's error most; among equally good sensors the first sensor is chosen."""
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
    best: tuple[int, ...] = ()
    least = np.inf
    for number, chosen in enumerate(draw_choices(count, draws, seed, student.sensors)):
        error = student.error(chosen)
        if error < least:
            best, least = chosen, error
        progress(Phase.SELECT, number + 1, draws, {"error": least})
    return best


def select(
    method: SelectionMethod,
    encoder: Encoder,
    rows: Rows,
    count: int,
    *,
    settings: TrainConfig,
    progress: Progress = silent,
) -> tuple[str, ...]:
    """Return the names of the chosen sensors, in the method's order, from rows with all sensors' columns.

    "shap": one repeat of the paper's ranking. "qr": pivots of the pressures' POD modes. "greedy": forward selection
    with the ridge student. "random": the best of `RANDOM_DRAWS` choices according to the ridge student. "hand": by
    position alone. The method uses only the seed and, for "shap", the numbers of draws from the settings. Raises
    ConfigError for an unknown method, too few sensors, or "hand" if the sensors have no mirror images or no base;
    DatasetError if `rows` has too few windows.
    """
    if method not in METHODS:
        raise ConfigError(f"unknown selection method {method!r}: use {', '.join(METHODS)}")
    check_count(count, rows.sensors)
    if method == "shap":
        ranker = ShapRanker.of(settings)
        return rank(ranker, encoder, rows, repeats=1, seed=settings.seed, progress=progress).top(count)
    if method == "qr":
        chosen = select_qr(rows, count)
    elif method == "hand":
        chosen = select_by_hand(count, rows.layout)
    else:
        # Runs with neighbouring seeds must have independent draws. The two uses of one seed must be independent, too.
        windows, choices = np.random.SeedSequence(settings.seed).generate_state(2).tolist()
        student = ridge_student(encoder, rows, windows, settings.sensor_noise)
        if method == "greedy":
            chosen = select_greedy(student, count, progress=progress)
        else:
            chosen = select_random(student, count, draws=RANDOM_DRAWS, seed=choices, progress=progress)
    return tuple(rows.layout.names[index] for index in chosen)
