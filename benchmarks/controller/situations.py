"""Recorded situations to plan in: windows of an episode, and plans that have receded over them as in the loop."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.common.command_line import track
from contract.arrays import Array
from contract.recording.dataset import Dataset, Episode
from export.program.controller_program import ControllerProgram
from export.program.recorded_windows import recorded_windows
from export.reference.model import encode
from export.reference.mpc import adam, shift

LEAD: Final = 30
"""Control steps before a figure counts: an action is planned 25 times before it is applied, so the first plans have
not had their iterations yet."""


def choose_episode(data: Dataset) -> Episode:
    """The last one recorded for training under a controller, else the chirp."""
    controlled = [
        item for item in data.episodes if item.role == "train" and item.provenance.get("forcing_signal") == "controlled"
    ]
    return controlled[-1] if controlled else data.with_role("test")[0]


def encode_windows(program: ControllerProgram, episode: Episode, steps: ArrayLike) -> tuple[Array, Array]:
    """Latent states (..., n_z) and previous actions (...,) at the episode's windows of these numbers (...,)."""
    windows = np.array(recorded_windows(program, episode, len(episode) - program.window + 1))[np.asarray(steps)]
    return encode(program, windows), windows[..., -1, -1]


def snapshot_steps(program: ControllerProgram, episode: Episode, snapshots: int) -> NDArray[np.int_]:
    """Numbers of windows, (LEAD + 1, n): n snapshots over the episode in the last row, the steps before above it."""
    last = np.linspace(LEAD, len(episode) - program.window, snapshots).astype(int)
    return last + np.arange(-LEAD, 1)[:, None]


def receding(program: ControllerProgram, z: Array, previous_action: Array, learning_rates: Array) -> Array:
    """Plans (t, n, H) of consecutive control steps, each from the one before, shifted.

    Args:
        z: latent states (t, n, n_z).
        previous_action: (t, n).
        learning_rates: of each of the n, (n,).
    """
    plans = [np.zeros((len(learning_rates), program.mpc.horizon))]
    every = np.tile(learning_rates, (program.mpc.iterations, 1))
    steps = list(zip(z, previous_action, strict=True))
    for now, before in track(steps, "receding", "steps"):
        *_, plan = adam(program, now, shift(plans[-1]), before, every)
        plans.append(plan)
    return np.array(plans[1:])
