"""The recorder's bookkeeping, on a plant that costs nothing; `test_recording_processes.py` has the real one."""

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.recording.dataset import Dataset, read
from tests.wake.recording.killing import Killed, equal, kill_before_operation
from wake.recording import episode_job, recorder
from wake.recording.episode_plan import EpisodePlan
from wake.recording.recorder import record
from wake.solver.grid import truck_grid
from wake.truck.truck_wake import TruckWake

pytestmark = pytest.mark.usefixtures("cheap_plant")

PLANS = [EpisodePlan(forcing="training", steps=7, seed=5, lead=2), EpisodePlan(forcing="none", steps=2, seed=0)]


def recorded(output: Path, plans: list[EpisodePlan] = PLANS, **arguments: Any) -> Dataset:
    record(output, plans, Config(), block_steps=3, **arguments)
    return read(output)


def test_samples_follow_the_timing_convention(tmp_path, monkeypatch, coarse):
    wake = TruckWake(coarse.flow)
    monkeypatch.setattr(recorder, "TruckWake", lambda config, *, body: wake)
    monkeypatch.setattr(episode_job, "developed_state", lambda: coarse.start)
    first = wake.reset(coarse.start)
    plan = EpisodePlan(forcing="training", steps=5, seed=5)
    record(tmp_path / "a.h5", [plan], Config(flow=coarse.flow), block_steps=3)
    episode = read(tmp_path / "a.h5").episodes[0]
    series = episode.series
    assert series["t"] == pytest.approx(0.2 * np.arange(5))
    assert series["Cd"][0] == pytest.approx(first.Cd, abs=2**-15)  # stored in 16 bits
    # Sample k is taken before a_k acts: the reaction to the jets' momentum still shows a_{k-1}.
    assert series["Cd_momentum"][1:] == pytest.approx(-4 * 1.2 / 0.05 * series["action"][:-1] ** 2, abs=2**-15)
    assert episode.initial_action == 0.0


def test_a_lead_passes_before_the_first_sample(tmp_path, oscillator):
    plan, plant = EpisodePlan(forcing="none", steps=4, seed=0, lead=6), oscillator()
    expected = [plant.advance(0.0) for _ in range(9)][5:]
    series = recorded(tmp_path / "a.h5", [plan]).episodes[0].series
    assert series["t"].tolist() == [sample.t for sample in expected]
    assert series["Cl"] == pytest.approx([sample.Cl for sample in expected], abs=2**-15)


def test_provenance_holds_how_each_episode_was_made(tmp_path):
    first, second = (episode.provenance for episode in recorded(tmp_path / "a.h5").episodes)
    for found, made in ((first, (5, 2, "training")), (second, (0, 0, "none"))):
        assert (found["seed"], found["lead_steps"], found["forcing_signal"]) == made
    assert first["forcing"]["base_frequency"] == 0.2 and first["flow"]["reynolds"] == 500.0
    assert first["grid"] == list(truck_grid().shape) and len(first["start_sha256"]) == 64
    assert {"python", "numpy", "numba", "scipy", "stillwake"} <= first["versions"].keys()


@pytest.mark.slow  # records once for every change
def test_it_may_be_killed_before_any_change_on_disk(tmp_path, oscillator):
    plans = [EpisodePlan(forcing="training", steps=5, seed=5, lead=2)]
    whole = recorded(tmp_path / "whole.h5", plans)
    number, killed = 1, True
    while killed:
        output = tmp_path / f"{number}.h5"
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(recorder, "TruckWake", oscillator)
            operations = kill_before_operation(patch, number)
            killed = False
            try:
                recorded(output, plans)
            except Killed:
                killed = True
        assert not killed or operations() >= number
        found = read(output) if output.exists() else recorded(output, plans)
        assert equal(found, whole), f"killed before operation {number}"
        number += 1
    assert number > 20


def test_a_full_disk_is_named_and_costs_nothing(tmp_path, monkeypatch):
    output, written = tmp_path / "a.h5", 0

    def fsync(descriptor: int) -> None:
        nonlocal written
        written += 1
        if written > 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fsync)
        with pytest.raises(StillwakeError, match=r"cannot write .*training_5/000003\.npz: No space left on device"):
            recorded(output)
    progress: list[tuple[str, int]] = []
    resumed = recorded(output, progress=lambda name, done, total: progress.append((name, done)))
    assert progress[0] == ("training_5", 3)
    assert equal(resumed, recorded(tmp_path / "whole.h5"))


def test_a_second_call_takes_over_and_the_first_stops(tmp_path):
    output = tmp_path / "a.h5"

    def interrupt(name: str, done: int, total: int) -> None:
        if done == 3 and not output.exists():
            recorded(output)

    with pytest.raises(StillwakeError, match="taken over"):
        recorded(output, progress=interrupt)
    assert equal(read(output), recorded(tmp_path / "whole.h5"))


def test_parts_that_do_not_fit_are_refused_by_what_differs(tmp_path):
    output, most = tmp_path / "a.h5", 0

    def stop(name: str, done: int, total: int) -> None:
        nonlocal most
        most = max(most, len(list(tmp_path.glob("a.h5.parts/training_5/*.state.npz"))))
        if done == 27:
            raise Killed

    plans = [EpisodePlan(forcing="training", steps=30, seed=5)]
    with pytest.raises(Killed):
        recorded(output, plans, progress=stop)
    assert most == 2, "only the last states are kept"
    with pytest.raises(StillwakeError, match=r"other settings \(block_steps\)"):
        record(output, plans, Config(), block_steps=4)
    block = tmp_path / "a.h5.parts" / "training_5" / "000000.npz"
    block.write_bytes(block.read_bytes()[:100])
    with pytest.raises(StillwakeError, match=r"000000\.npz: damaged block"):
        recorded(output, plans)
    label = tmp_path / "a.h5.parts" / "task.json"
    label.write_text("{")
    with pytest.raises(StillwakeError, match="unknown recording: delete it first"):
        recorded(output, plans)
