"""`record`: rounds are added, a recording that is whole stays, and a steady wake that is not there is made."""

from pathlib import Path

import numpy as np
import pytest

from contract.config.tree import Config
from contract.recording import dataset
from wake.recording import recorder
from wake.recording.plans import CalmRound
from wake.truck import develop
from wake.truck.develop import start_from_rest
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake


@pytest.mark.slow
def test_a_steady_wake_that_is_not_there_is_computed_and_kept(printed, tmp_path, monkeypatch, short_release):
    def halves_alike(wake: TruckWake, progress: object) -> tuple[State, dict[str, float]]:
        start_from_rest(wake)
        return wake.state(), {}

    monkeypatch.setattr(develop, "settle", halves_alike)
    # From rest the flow starts at once: for the rest of the command this is steady enough.
    monkeypatch.setattr(develop, "_RATE", 1e3)
    output, state = tmp_path / "a.h5", tmp_path / "steady.npz"
    call = ["record", output, "calm=5", "--from-steady", state, "--episodes", 1, "--set", "flow.refinement=0.4"]
    assert "is not there: computing the steady wake" in printed(*call)
    assert "is not there" not in printed(*call, "--under", short_release)
    alone, under = dataset.read(output).episodes
    assert [alone.name, under.name] == ["calm_1_0", "calm_2_0"]
    assert alone.provenance["start"] == "steady.npz"
    assert (alone.provenance["bundle"], under.provenance["bundle"]) == (None, "random")
    # The window has four rows: only then the controller acts as well.
    signals = [CalmRound(episodes=1, steps=5).plans(n)[0].signal(Config()) for n in (1, 2)]
    assert np.array_equal(alone.series["action"], signals[0])
    assert np.array_equal(under.series["action"][:3], signals[1][:3])
    assert not np.isclose(under.series["action"][3:], signals[1][3:]).any()


def test_a_recording_that_is_whole_says_so(printed, tmp_path, monkeypatch):
    (tmp_path / "a.h5").write_bytes(b"whole")
    seen = dict[str, object]()

    def record(output, plans, config, **options):
        seen.update(options)
        return False

    monkeypatch.setattr(recorder, "record", record)
    out = printed("record", tmp_path / "a.h5", "training=20", "--state", "s.npz")
    assert f"already complete, nothing to record: {tmp_path / 'a.h5'}: 2020 control steps" in out
    assert (seen["start"], seen["overwrite"]) == (Path("s.npz"), False)


@pytest.mark.slow
def test_rounds_under_a_controller_are_added(printed, tmp_path, short_release, coarse):
    output = tmp_path / "a.h5"
    for number in (1, 2):
        what = ("controlled=2", "--episodes", 1, "--role", "train", *coarse.words)
        out = printed("record", output, "--under", short_release, *what)
        assert f"round {number}, 2 control steps under the controller" in out.replace("\n", " ")
    found = dataset.read(output).episodes
    facts = [(one.name, one.role, len(one)) for one in found]
    assert facts == [("controlled_1_0", "train", 2), ("controlled_2_0", "train", 2)]
    assert found[0].provenance["bundle"] == "random"
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]
