"""A recording is never replaced by chance; and it may begin in any flow state."""

import hashlib
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from contract.config.tree import Config
from contract.errors import OutputError, PlantError, StillwakeError
from contract.recording.dataset import read
from contract.shipped import RECORDING
from wake.recording import recorder
from wake.recording.episode_plan import EpisodePlan, paper_plans
from wake.truck.state import Origin, State, save_state

pytestmark = pytest.mark.usefixtures("cheap_plant")

TRAINING = EpisodePlan(forcing="training", steps=7, seed=5, lead=2)
NONE = EpisodePlan(forcing="none", steps=2, seed=0)
PLANS = (TRAINING, NONE)


@pytest.fixture
def output(tmp_path) -> Path:
    assert record(tmp_path / "a.h5")
    return tmp_path / "a.h5"


def record(path: Path, plans: tuple[EpisodePlan, ...] = PLANS, config: Config | None = None, **options: Any) -> bool:
    return recorder.record(path, plans, Config() if config is None else config, block_steps=3, **options)


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
    with pytest.raises(OutputError, match="holds a file that cannot be read"):
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
    with pytest.raises(StillwakeError, match=r"start\.npz: not a flow state"):
        record(tmp_path / "a.h5", start=tmp_path / "start.npz")
    assert list(tmp_path.iterdir()) == []


def test_a_recording_begins_in_the_state_it_is_given(tmp_path, oscillator):
    flat = np.array([0.3, -0.2])
    start = tmp_path / "start.npz"
    save_state(start, State(flat=flat, substep=0, action=0.0, origin=Origin(shape=(443, 164), reynolds=1000.0)))
    output, config = tmp_path / "a.h5", replace(Config(), flow=replace(Config().flow, reynolds=1000.0))
    with pytest.raises(PlantError, match=r"reynolds = 1000, this plant has 500: `stillwake develop start_re500\.npz"):
        record(output, (NONE,), start=start)
    assert record(output, (NONE,), config, start=start)
    episode = read(output).episodes[0]
    first = oscillator().reset(State(flat=flat, substep=0, action=0.0))
    assert episode.series["Cd"][0] == pytest.approx(first.Cd, abs=2**-15)  # stored in 16 bits
    assert episode.provenance["start"] == "start.npz"
    assert episode.provenance["start_sha256"] == hashlib.sha256(start.read_bytes()).hexdigest()
    assert not record(output, (NONE,), config, start=start)
    with pytest.raises(OutputError, match=r"has start = start\.npz, not developed\.npz"):
        record(output, (NONE,), config)
