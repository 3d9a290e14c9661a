"""The methods behind one interface: a teacher, its recording and a budget in, names of sensors out."""

from typing import Final, get_args

import numpy as np

from contract.config.learning import SelectionMethod, TrainConfig
from contract.errors import ConfigError
from train.fitting.progress import Progress, silent
from train.networks.model import Encoder
from train.samples.rows import Rows
from train.selection.budget import check_count
from train.selection.greedy_forward import select_greedy
from train.selection.hand_choice import select_by_hand
from train.selection.qr_pivoting import select_qr
from train.selection.random_draws import select_random
from train.selection.ridge_student import ridge_student
from train.selection.shap_ranking import ShapRanker, rank

METHODS: Final[tuple[SelectionMethod, ...]] = get_args(SelectionMethod)

RANDOM_DRAWS: Final = 64
"""Choices that "random" judges."""


def select(
    method: SelectionMethod,
    encoder: Encoder,
    rows: Rows,
    count: int,
    *,
    settings: TrainConfig,
    progress: Progress = silent,
) -> tuple[str, ...]:
    """Names of the chosen sensors, in the method's order.

    "shap": one repeat of the paper's ranking. "qr": pivots of the pressures' POD modes. "greedy": forward selection by
    the ridge student. "random": the best of `RANDOM_DRAWS` by that student. "hand": by position alone. Raises
    ConfigError for an unknown method, too few sensors, or "hand" where the sensors have no mirror images or base;
    DatasetError if `rows` hold too few windows.

    Args:
        rows: with all sensors' columns.
        settings: its seed and, for "shap", its draws are used.
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
        # Neighbouring run seeds, and the two uses of one, must not share draws.
        windows, choices = np.random.SeedSequence(settings.seed).generate_state(2).tolist()
        student = ridge_student(encoder, rows, windows, settings.sensor_noise)
        if method == "greedy":
            chosen = select_greedy(student, count, progress=progress)
        else:
            chosen = select_random(student, count, draws=RANDOM_DRAWS, seed=choices, progress=progress)
    return tuple(rows.layout.names[index] for index in chosen)
