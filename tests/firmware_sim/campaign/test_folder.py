"""What a campaign leaves in its folder, and which other things it keeps out; its starting phases, on the real wake."""

from dataclasses import replace

import numpy as np
import pytest

from contract.config.body import BodyConfig
from contract.config.plant import ForcingConfig
from contract.config.tree import Config
from contract.errors import OutputError, StillwakeError
from firmware_sim.campaign.folder import CampaignFolder, RunOutcome, keep_states, phases_apart, starting_states
from tests.firmware_sim.campaign.conftest import phase_of
from wake.truck.state import State, developed_state
from wake.truck.truck_wake import TruckWake

LABEL = {"schema": "stillwake-campaign/1", "seed": 1, "settings": {"a": [1, 2]}}


def test_a_run_is_kept_by_its_key_and_another_campaign_refused_by_what_differs(tmp_path) -> None:
    folder = CampaignFolder(tmp_path / "campaign")
    folder.check(LABEL, overwrite=False)
    assert not folder.path.exists()
    folder.path.mkdir()
    (folder.path / ".figures.json.lock").touch()  # of a killed process
    folder.check(LABEL, overwrite=False)
    folder.claim(LABEL)
    path, without_control = folder.path / "runs" / "one.json", RunOutcome(key="k", figures=phase_of().free.figures)
    for outcome in (without_control, phase_of(in_control=3, latches=1, broken=["it broke"]).under):
        folder.keep("one", outcome)
        assert folder.outcome("one", "k") == outcome
        whole = path.read_bytes()
        folder.keep("one", outcome)
        assert path.read_bytes() == whole
    assert folder.outcome("one", "another key") is None
    # A damaged file counts as missing.
    damaged = [b"[]", b"{}", b'{"schema": "stillwake-campaign-run/1"}', b"\xff", b"null"]
    for content in (*damaged, *(whole[:length] for length in range(0, len(whole) - 1, 7))):
        path.write_bytes(content)
        assert folder.outcome("one", "k") is None, content
    other = {**LABEL, "seed": 2}
    with pytest.raises(OutputError, match="other seed;"):
        folder.check(other, overwrite=False)
    folder.check(other, overwrite=True)
    assert folder.finished == 1
    folder.claim(other)
    assert folder.finished == 0


def test_a_folder_of_something_else_is_never_touched(tmp_path) -> None:
    (tmp_path / "mine").write_text("text")
    for overwrite in (False, True):
        with pytest.raises(OutputError, match="no campaign wrote"):
            CampaignFolder(tmp_path).check(LABEL, overwrite=overwrite)
    with pytest.raises(StillwakeError, match="it is a file"):
        CampaignFolder(tmp_path / "mine").check(LABEL, overwrite=True)
    assert (tmp_path / "mine").read_text() == "text"


@pytest.mark.slow  # advances the real wake
def test_phases_follow_each_other_in_the_developed_wake(shared_wake, tmp_path) -> None:
    assert phases_apart(3, Config()) == [0, 8, 17]
    # A cycle of 5 periods in place of 25, of which two make a half.
    folder, config = CampaignFolder(tmp_path), Config(forcing=ForcingConfig(base_frequency=1.0))
    states = starting_states(folder, config, 2)
    assert [(state.substep, state.action) for state in states] == [(0, 0.0)] * 2
    shared_wake.reset(replace(developed_state(), substep=0, action=0.0))
    np.testing.assert_array_equal(states[0].flat, developed_state().flat)
    for _ in range(2):
        shared_wake.advance(0.0)
    np.testing.assert_array_equal(states[1].flat, shared_wake.state().flat)
    assert list(tmp_path.iterdir()) == []
    keep_states(folder, states)
    for state, again in zip(states, starting_states(folder, config, 2), strict=True):
        np.testing.assert_array_equal(again.flat, state.flat)
    assert (states[0].flat != states[1].flat).any()


@pytest.mark.slow  # advances the real wake
def test_another_bodys_wake_is_developed_once_and_no_start_of_the_trucks_is_taken(coarse, tmp_path, monkeypatch):
    folder, developed = CampaignFolder(tmp_path), list[BodyConfig]()
    config = Config(flow=coarse.flow, body=BodyConfig(length=1.0, leading_edge_radius=0.0))
    keep_states(folder, [coarse.start], "box")

    def at_rest(wake: TruckWake, **_progress: object) -> None:
        developed.append(wake.body)
        wake.reset(State(flat=wake.solver.start().flat, substep=0, action=0.0))

    monkeypatch.setattr("firmware_sim.campaign.folder.develop", at_rest)
    made = starting_states(folder, config, 1, "box")
    keep_states(folder, made, "box")
    (again,) = starting_states(folder, config, 1, "box")
    assert developed == [config.body]
    np.testing.assert_array_equal(again.flat, made[0].flat)
