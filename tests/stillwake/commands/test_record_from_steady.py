"""`record --from-steady`: a steady wake that is not there is made."""

from types import SimpleNamespace

import numpy as np
import pytest

from contract.config.tree import Config
from contract.recording import dataset
from wake.recording.round_plan import CalmRound
from wake.truck import steady
from wake.truck.develop import start_from_rest
from wake.truck.truck_wake import TruckWake


@pytest.mark.slow
def test_a_steady_wake_that_is_not_there_is_computed_and_kept(cli, tmp_path, monkeypatch, short_release):
    def halves_alike(wake: TruckWake, progress: object) -> SimpleNamespace:
        start_from_rest(wake)
        return SimpleNamespace(state=wake.state())

    monkeypatch.setattr(steady, "settle", halves_alike)
    # From rest the flow starts at once: for the rest of the command this is steady enough.
    monkeypatch.setattr(steady, "_RATE", 1e3)
    output, state = tmp_path / "a.h5", tmp_path / "steady.npz"
    call = ["record", output, "calm=5", "--from-steady", state, "--episodes", 1, "--set", "flow.refinement=0.4"]
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
