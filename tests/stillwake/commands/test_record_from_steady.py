"""`record --from-steady`: what makes no sense is refused, and a steady wake that is not there is made."""

from types import SimpleNamespace

import numpy as np
import pytest

from contract.config.tree import Config
from contract.recording import dataset
from contract.shipped import developed
from wake.recording.calm_plan import CalmRound
from wake.truck import steady
from wake.truck.develop import start_from_rest
from wake.truck.truck_wake import TruckWake


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--calm", 5], "give --from-steady FILE as well"),
        (["--amplitudes", 0.001, 0.002], "give --from-steady FILE as well"),
        (["--from-steady", "s.npz", "--paper"], "--from-steady and --paper are two recordings"),
        (["--from-steady", "s.npz", "--chirp", 5], "--chirp does not go with --from-steady: give --calm"),
        (["--from-steady", "s.npz", "--exploration", 0.1], "--exploration does not go with --from-steady"),
        (["--from-steady", "s.npz", "--start", "d.npz"], "--start does not go with --from-steady"),
        (["--from-steady", "s.npz", "--overwrite"], "--overwrite does not go with --from-steady"),
        (["--from-steady", "s.npz", "--role", "controlled"], "role = 'controlled': must be one of train, calm"),
        (["--from-steady", "s.npz", "--amplitudes", 0, 0.1], "smallest amplitude = 0.0: must be finite and positive"),
        (["--from-steady", "s.npz", "--amplitudes", 0.2, 0.1], "0.2: must not exceed the largest, 0.1"),
    ],
)
def test_a_recording_from_the_steady_wake_that_makes_no_sense(refused, tmp_path, arguments, named):
    assert named in refused("record", tmp_path / "a.h5", *arguments)


@pytest.mark.slow
def test_a_recording_does_not_begin_in_another_flow_than_the_steady_one(refused, tmp_path):
    line = refused("record", tmp_path / "a.h5", "--from-steady", developed())
    assert "not the steady wake: velocities differ from their mirror image" in line


@pytest.mark.slow
def test_a_steady_wake_that_is_not_there_is_computed_and_kept(cli, tmp_path, monkeypatch, short_release):
    def halves_alike(wake: TruckWake, progress: object) -> SimpleNamespace:
        start_from_rest(wake)
        return SimpleNamespace(state=wake.state())

    monkeypatch.setattr(steady, "settle", halves_alike)
    # From rest the flow starts at once: for the rest of the command this is steady enough.
    monkeypatch.setattr(steady, "_RATE", 1e3)
    output, state = tmp_path / "a.h5", tmp_path / "steady.npz"
    call = ["record", output, "--from-steady", state, "--calm", 5, "--episodes", 1, "--set", "flow.refinement=0.4"]
    first, second = cli(*call), cli(*call, "--under", short_release)
    assert (first.code, first.err) == (second.code, second.err) == (0, "")
    assert "is not there: computing the steady wake" in first.out
    assert "is not there" not in second.out
    alone, under = dataset.read(output).episodes
    assert [alone.name, under.name] == ["calm_1_0", "calm_2_0"]
    assert alone.provenance["start"] == "steady.npz"
    assert (alone.provenance["bundle"], under.provenance["bundle"]) == (None, "random")
    # The window has four rows: only then the controller acts as well.
    signals = [CalmRound(episodes=1, steps=5).plans(n)[0].signal(Config()) for n in (1, 2)]
    assert np.array_equal(alone.series["action"], signals[0])
    assert np.array_equal(under.series["action"][:3], signals[1][:3])
    assert not np.isclose(under.series["action"][3:], signals[1][3:]).any()
