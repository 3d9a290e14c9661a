"""The release's kind of controller, its networks tuned on episodes that begin at the steady wake."""

import shutil
import time
from pathlib import Path
from typing import Final

import torch

from benchmarks.common.command_line import MODEL, track
from benchmarks.common.parts import part
from benchmarks.controller.operations.chosen import RELEASE
from benchmarks.controller.operations.travelling import TravellingController
from benchmarks.roads.calm_tuning import Tuning, tune
from benchmarks.roads.loop import Setting, through_can
from benchmarks.roads.release import recorded_periods
from benchmarks.roads.row import Outcome, Row
from contract import model_folder
from contract.recording.dataset import Episode, read
from contract.release import bundle as bundles
from export.program.from_training import program_of
from stillwake.settling import settle_into
from stillwake.shipped import BUNDLE
from train import model_store
from wake.recording.calm_plan import CalmRound
from wake.recording.controlled_recording import record_round
from wake.shipped import RECORDING
from wake.truck.state import State

ROUND: Final = CalmRound()
_BESIDE: Final = "training_3"
"""Of the forced episodes one, so that strong forcing is not forgotten."""


def measure(road: str, setting: Setting) -> Row:
    """Its row; recording, tuned model and runs are kept in the road's folder."""
    made = part(setting.folder / "tuning.json", lambda: _tuned(setting))
    model = model_folder.read(setting.folder / "model")
    release = bundles.load(BUNDLE)
    program = program_of(model, release.manifest.mpc)

    def run(start: State) -> Outcome:
        return through_can(release, setting.config, start, TravellingController(program, RELEASE))

    return Row(
        road=road,
        title="release, tuned on the calm wake",
        kind="learned",
        outcomes=setting.outcomes(run),
        sensors=len(release.manifest.sensors),
        loop="CAN",
        mesh=setting.mesh,
        interactions=recorded_periods() + ROUND.episodes * ROUND.steps,
        training_minutes=made["minutes"],
        seeds=(ROUND.seed,),
        note="started at the steady wake it leaves it as the release does, some 10 t_c later",
    )


def _tuned(setting: Setting) -> dict[str, float]:
    torch.set_num_threads(1)
    tuning, source, episodes = Tuning(), model_folder.read(MODEL), _episodes(setting)
    began = time.process_time()
    tuned = tune(model_store.load(MODEL), episodes, tuning, track(range(tuning.steps), "tuning", "iterations"))
    model_folder.write(setting.folder / "model", source.description, {**source.tensors, **tuned})
    return {"minutes": (time.process_time() - began) / 60.0}


def _episodes(setting: Setting) -> tuple[Episode, ...]:
    """The shipped rounds and one forced episode, and the calm ones, which are recorded if they are not there."""
    recording = setting.folder / "recording.h5"
    if not recording.exists():
        shutil.copyfile(RECORDING, recording)
    if not any(item.name.startswith("calm_") for item in read(recording).episodes):
        record_round(recording, ROUND, setting.config, start=_steady(setting))
    kept = ("calm_", "controlled_", _BESIDE)
    return tuple(item for item in read(recording).episodes if item.role == "train" and item.name.startswith(kept))


def _steady(setting: Setting) -> Path:
    state = setting.folder / "steady.npz"
    if not state.exists():
        settle_into(state, setting.config)
    return state
