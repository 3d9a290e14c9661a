"""`stillwake develop`, with `--steady` and without: what they write, with the plant's long runs replaced."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from wake.truck import develop, truck_wake
from wake.truck.state import State, load_state
from wake.truck.truck_wake import TruckWake


@pytest.fixture
def plant(shared_wake, monkeypatch) -> TruckWake:
    """What the commands build."""
    flat = np.linspace(0.0, 1.0, shared_wake.flow.flat.size)
    shared_wake.reset(replace(shared_wake.state(), flat=flat, substep=0, action=0.0))
    monkeypatch.setattr(truck_wake, "TruckWake", lambda config, *, body: shared_wake)
    return shared_wake


def test_develop_writes_the_state_it_ends_in(plant, tmp_path, printed, monkeypatch) -> None:
    monkeypatch.setattr(develop, "develop", lambda wake, duration, progress: wake.state())
    # A name that looks like markup is printed as it is.
    assert "a[red]b[;x.npz" in printed("develop", tmp_path / "a[red]b[;x.npz", "--duration", "3")
    assert np.array_equal(load_state(tmp_path / "a[red]b[;x.npz").flat, plant.state().flat)


def test_steady_writes_state_and_figures(plant, tmp_path, printed, monkeypatch) -> None:
    settled, figures = plant.state(), {"Cd": 0.66, "recirculation_length": 4.25}

    def settle(wake: TruckWake, progress) -> tuple[State, dict[str, float]]:
        assert wake is plant
        progress(0.2, 30.0)
        progress(0.4, 1e-9)
        return settled, figures

    monkeypatch.setattr(develop, "settle", settle)
    out = printed("develop", tmp_path / "s.npz", "--steady", "--json", tmp_path / "s.json")
    assert re.search(r"recirculation_length\s+4\.25", out)
    assert np.array_equal(load_state(tmp_path / "s.npz").flat, settled.flat)
    written = json.loads((tmp_path / "s.json").read_text(encoding="utf-8"))
    assert written["figures"] == figures
    assert written["facts"]["grid"] == list(plant.grid.shape)
