"""Recorded situations to plan in: windows of an episode, and plans that have receded over them as in the loop."""

from typing import Final

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.controller.many_plans import adam
from contract.recording.dataset import Dataset, Episode
from export.program.controller_program import ControllerProgram
from export.program.recorded_windows import recorded_windows
from export.program.weights import Array
from export.reference.model import encode
from export.reference.mpc import shift

LEAD: Final = 30
"""Control steps before a figure counts: an action is planned 25 times before it is applied, so the first plans have
not had their iterations yet."""


def choose_episode(data: Dataset) -> Episode:
    """The last one recorded for training under a controller, else the chirp."""
    controlled = [
        item for item in data.episodes if item.role == "train" and item.provenance.get("forcing_signal") == "controlled"
    ]
    return controlled[-1] if controlled else data.with_role("test")[0]


def see(program: ControllerProgram, episode: Episode, steps: range) -> tuple[Array, Array]:
    """Latent states (n, n_z) and actions in force (n,) at these of the episode's windows."""
    windows = recorded_windows(program, episode, len(episode) - program.window + 1)
    chosen = [windows[k] for k in steps]
    return np.array([encode(program, window) for window in chosen]), np.array([window[-1, -1] for window in chosen])


def see_before(program: ControllerProgram, episode: Episode, snapshots: int) -> tuple[Array, Array]:
    """The `LEAD` steps before each of the snapshots, and these: (LEAD + 1, n, n_z) and (LEAD + 1, n)."""
    count = len(episode) - program.window + 1
    ends = np.linspace(LEAD, count - 1, snapshots).astype(int)
    seen = [see(program, episode, range(end - LEAD, end + 1)) for end in ends]
    return np.stack([item[0] for item in seen], axis=1), np.stack([item[1] for item in seen], axis=1)


def receding(program: ControllerProgram, z: Array, previous: Array, rates: Array) -> Array:
    """Plans (t, n, H) of consecutive control steps, each from the one before, shifted; z (t, n, n_z), rates (n,)."""
    plans = [np.zeros((len(rates), program.mpc.horizon))]
    iterations = program.mpc.iterations
    steps = list(zip(z, previous, strict=True))
    for now, in_force in track(steps, "receding", console=Console(stderr=True)):
        every = np.tile(rates, (iterations, 1))
        plans.append(adam(program, now, shifted(plans[-1]), in_force, every)[iterations])
    return np.array(plans[1:])


def shifted(plans: Array) -> Array:
    """Every plan (n, H) one step on."""
    return np.array([shift(plan) for plan in plans])
