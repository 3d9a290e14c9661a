"""The release's kind of controller, its networks tuned on episodes that begin at the steady wake."""

import shutil
import time
from functools import partial
from pathlib import Path
from typing import Final

import torch

from benchmarks.common.command_line import MODEL, track
from benchmarks.common.commands import ROOT
from benchmarks.common.markdown import read as read_results
from benchmarks.common.parts import part
from benchmarks.roads.calm_tuning import Tuning, tune
from benchmarks.roads.loop import Setting, through_can
from benchmarks.roads.release import recorded_periods
from benchmarks.roads.row import Outcome, Row
from contract.arrays import Array
from contract.config.body_sensors import layout_of
from contract.controller.interface import ControlStep
from contract.model import model_folder
from contract.recording.dataset import Episode, read
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.shipped import BUNDLE, RECORDING
from export.program.controller_program import ControllerProgram
from export.program.from_training import program_of
from export.reference.mpc import control_step
from firmware_sim.ecu.bundle_policy import BundlePolicy
from stillwake.console.settling import settle_into
from train import model_store
from wake.recording.calm_plan import CalmRound
from wake.recording.controlled_plan import ControlledRound
from wake.recording.controlled_recording import record_round
from wake.recording.feedback import NoFeedback
from wake.truck.state import State

_BESIDE: Final = "training_3"
"""One of the forced episodes, so that strong forcing is not forgotten."""


class _Reference:
    """The NumPy reference as the ECU's controller."""

    def __init__(self, program: ControllerProgram) -> None:
        self.description = f"NumPy, Adam, {program.mpc.iterations} iterations"
        self._program = program

    def warm_up(self, steps: int) -> None:
        """Do nothing: no call is slower than another."""

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> ControlStep:
        """One control step, as `contract.controller.interface` describes it."""
        return control_step(self._program, window, plan, free, weights)


def rounds(release: Bundle) -> tuple[CalmRound | ControlledRound, ...]:
    """What is recorded in addition to the shipped episodes: the way up from the steady wake, alone and under the
    release, and the way down to the plateau."""
    name, digest = release.manifest.name, release.digest
    return (
        CalmRound(),
        CalmRound(episodes=3, steps=300, smallest=0.002, largest=0.01, bundle=name, bundle_digest=digest),
        ControlledRound(episodes=2, steps=400, exploration=0.12, bundle=name, bundle_digest=digest),
    )


def measure(road: str, setting: Setting) -> Row:
    """Its row; recording, tuned model and runs are kept in the road's folder."""
    made = part(setting.folder / "tuning.json", lambda: _tuned(setting))
    model = model_folder.read(setting.folder / "model")
    release = bundles.load(BUNDLE)
    program = program_of(model, release.manifest.mpc)

    def run(start: State) -> Outcome:
        return through_can(release, setting.config, start, _Reference(program))

    return Row(
        road=road,
        title="release, tuned on the calm wake",
        kind="learned",
        outcomes=setting.outcomes(run),
        sensors=len(release.manifest.sensors),
        loop="CAN",
        mesh=setting.mesh,
        interactions=recorded_periods() + sum(item.episodes * item.steps for item in rounds(release)),
        training_minutes=made["minutes"],
        # Networks of the release's shapes.
        m7_ms=read_results(ROOT / "results" / "operations.json")["figures"]["encoder"]["step_ms_480"],
        seeds=(CalmRound.seed,),
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
    release = bundles.load(BUNDLE)
    policy = partial(BundlePolicy, release, layout=layout_of(setting.config.body))
    there = max(int(item.provenance.get("round", 0)) for item in read(recording).episodes)
    shipped = max(int(item.provenance.get("round", 0)) for item in read(RECORDING).episodes)
    for wanted in rounds(release)[there - shipped :]:
        start = _steady(setting) if isinstance(wanted, CalmRound) else None
        driver = NoFeedback if wanted.bundle is None else policy
        record_round(recording, wanted, setting.config, driver, start=start)
    kept = ("calm_", "controlled_", _BESIDE)
    return tuple(item for item in read(recording).episodes if item.role == "train" and item.name.startswith(kept))


def _steady(setting: Setting) -> Path:
    state = setting.folder / "steady.npz"
    if not state.exists():
        settle_into(state, setting.config)
    return state
