"""The recorder's bookkeeping, on a plant that costs nothing; `test_recording_processes.py` has the real one."""

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from contract.config.tree import Config
from contract.errors import OutputError, PlantError, StillwakeError
from contract.recording.dataset import Dataset, read
from contract.shipped import RECORDING
from tests.wake.conftest import Killed, Oscillator, equal
from wake.recording import episode_job, recorder
from wake.recording.plans import EpisodePlan, paper_plans
from wake.truck.state import Origin, State, save_state
from wake.truck.truck_wake import TruckWake

pytestmark = pytest.mark.usefixtures("cheap_plant")

TRAINING = EpisodePlan(forcing="training", steps=7, seed=5, lead=2)
NONE = EpisodePlan(forcing="none", steps=2, seed=0)
PLANS = (TRAINING, NONE)


def record(path: Path, plans: Sequence[EpisodePlan] = PLANS, config: Config | None = None, **options: Any) -> bool:
    config = Config() if config is None else config
    return recorder.record(path, plans, config, **{"block_steps": 3, **options})


def recorded(output: Path, plans: Sequence[EpisodePlan] = PLANS, **arguments: Any) -> Dataset:
    record(output, plans, **arguments)
    return read(output)


@pytest.fixture
def output(tmp_path) -> Path:
    assert record(tmp_path / "a.h5")
    return tmp_path / "a.h5"


def test_samples_follow_the_timing_convention(tmp_path, monkeypatch, coarse):
    wake = TruckWake(coarse.flow)
    monkeypatch.setattr(recorder, "TruckWake", lambda config, *, body: wake)
    monkeypatch.setattr(episode_job, "developed_state", lambda: coarse.start)
    first = wake.reset(coarse.start)
    plan = EpisodePlan(forcing="training", steps=5, seed=5)
    episode = recorded(tmp_path / "a.h5", [plan], config=Config(flow=coarse.flow)).episodes[0]
    series = episode.series
    assert series["t"] == pytest.approx(0.2 * np.arange(5))
    assert series["Cd"][0] == pytest.approx(first.Cd, abs=2**-15)  # stored in 16 bits
    # Sample k is taken before a_k acts: the reaction to the jets' momentum still shows a_{k-1}.
    assert series["Cd_momentum"][1:] == pytest.approx(-4 * 1.2 / 0.05 * series["action"][:-1] ** 2, abs=2**-15)
    assert episode.initial_action == 0.0


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
    # The names have six digits and, from a million steps on, seven.
    blocks = episode_job.EpisodeBlocks(folder=tmp_path, steps=1_000_002, block_steps=500_001)
    for start in (999_998, 999_999, 1_000_000):
        blocks._state(start).touch()
    blocks.add({"t": np.zeros(1)}, State(flat=np.zeros(1), substep=0, action=0.0), np.zeros(1))
    assert {path.name for path in tmp_path.glob("*.state.npz")} == {"999999.state.npz", "1000000.state.npz"}
    with pytest.raises(StillwakeError, match=r"other settings \(block_steps\)"):
        record(output, plans, block_steps=4)
    block = tmp_path / "a.h5.parts" / "training_5" / "000000.npz"
    block.write_bytes(block.read_bytes()[:100])
    with pytest.raises(StillwakeError, match=r"000000\.npz: block is damaged"):
        recorded(output, plans)
    label = tmp_path / "a.h5.parts" / "task.json"
    label.write_text("{")
    with pytest.raises(StillwakeError, match="unknown recording: delete this folder first"):
        recorded(output, plans)


def test_the_same_plans_and_settings_leave_a_finished_recording_as_it_is(output):
    before = output.read_bytes()
    assert not record(output)
    assert output.read_bytes() == before
    # Another version of the software made the same recording.
    with h5py.File(output, "r+") as file:
        for node in file["episodes"].values():
            node.attrs["provenance"] = node.attrs["provenance"].replace('"numba": "', '"numba": "9')
    assert not record(output)
    output.write_text("a thesis")
    with pytest.raises(OutputError, match="exists, but cannot be read"):
        record(output)
    assert output.read_text() == "a thesis"


def test_another_recording_is_refused_by_what_differs(output):
    before = output.read_bytes()
    for plans, reynolds, named in (
        ((replace(TRAINING, steps=20), NONE), 500.0, "episode training_5 has 7 steps, not 20"),
        ((TRAINING,), 500.0, "it also has episode none_0"),
        (PLANS, 1000.0, r"episode training_5 has flow.reynolds = 500.0, not 1000.0"),
    ):
        config = replace(Config(), flow=replace(Config().flow, reynolds=reynolds))
        with pytest.raises(OutputError, match=rf"{named}.*; give --overwrite to replace it, or another name"):
            record(output, plans, config)
        assert output.read_bytes() == before
        assert [path.name for path in output.parent.iterdir()] == ["a.h5"]


@pytest.mark.slow
def test_the_shipped_recording_is_the_papers_with_rounds(tmp_path, monkeypatch):
    monkeypatch.undo()
    copy = Path(shutil.copy(RECORDING, tmp_path / "a.h5"))
    assert not record(copy, paper_plans())
    with pytest.raises(OutputError, match="episode training_2 has lead_steps = 2, not 0"):
        record(copy, paper_plans(seed=2))


def test_the_old_one_stays_until_the_new_one_is_whole(output):
    before = output.read_bytes()

    def stop(name: str, done: int, total: int) -> None:
        if done == 3:
            assert output.read_bytes() == before
            raise KeyboardInterrupt

    longer = (replace(TRAINING, steps=9), NONE)
    with pytest.raises(KeyboardInterrupt):
        record(output, longer, overwrite=True, progress=stop)
    assert output.read_bytes() == before
    assert record(output, longer, overwrite=True)
    assert [len(episode) for episode in read(output).episodes] == [9, 2]


def test_a_start_that_failed_leaves_nothing(tmp_path, monkeypatch):
    def diverging(config: object, body: object) -> None:
        raise PlantError("flow diverged")

    monkeypatch.setattr(recorder, "TruckWake", diverging)
    with pytest.raises(PlantError, match="flow diverged"):
        record(tmp_path / "new" / "deep" / "a.h5")
    with pytest.raises(StillwakeError, match=r"start\.npz is not a flow state"):
        record(tmp_path / "a.h5", start=tmp_path / "start.npz")
    assert list(tmp_path.iterdir()) == []


def test_a_recording_begins_in_the_state_it_is_given(tmp_path):
    flat = np.array([0.3, -0.2])
    start = tmp_path / "start.npz"
    save_state(start, State(flat=flat, substep=0, action=0.0, origin=Origin(shape=(443, 164), reynolds=1000.0)))
    output, config = tmp_path / "a.h5", replace(Config(), flow=replace(Config().flow, reynolds=1000.0))
    with pytest.raises(PlantError, match=r"reynolds = 1000, this plant has 500: `stillwake develop start_re500\.npz"):
        record(output, (NONE,), start=start)
    assert record(output, (NONE,), config, start=start)
    episode = read(output).episodes[0]
    first = Oscillator().reset(State(flat=flat, substep=0, action=0.0))
    assert episode.series["Cd"][0] == pytest.approx(first.Cd, abs=2**-15)  # stored in 16 bits
    assert {"python", "numpy", "numba", "scipy", "stillwake"} <= episode.provenance["versions"].keys()
    assert episode.provenance["start"] == "start.npz"
    assert episode.provenance["start_sha256"] == hashlib.sha256(start.read_bytes()).hexdigest()
    assert not record(output, (NONE,), config, start=start)
    with pytest.raises(OutputError, match=r"has start = start\.npz, not developed\.npz"):
        record(output, (NONE,), config)
