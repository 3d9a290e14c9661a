"""A campaign's runs, which are made up here, and its folder: what is run, what is kept, and what it keeps out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contract.config.body import BodyConfig
from contract.config.plant import ForcingConfig
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import ConfigError, OutputError, StillwakeError
from contract.release import bundle
from firmware_sim.bench.simulation import Spans
from firmware_sim.campaign.conduct import Campaign, RunTask, conduct, seed_of, settings_of
from firmware_sim.campaign.folder import CampaignFolder, RunOutcome, keep_states, phases_apart, starting_states
from tests.ecu.conftest import make_bundle
from tests.firmware_sim.campaign.conftest import Worker, phase_of, scenario_of
from wake.truck.state import State, developed_state
from wake.truck.truck_wake import TruckWake

SCENARIOS = (
    scenario_of("undisturbed"),
    scenario_of("noise_0.5", "A", disturb=("noise:level=0.5",)),
    scenario_of("gust", "B", disturb=("gust:amplitude=0.1,period=20",)),
)
TIMING = Spans(averages=False, lead_in=7.0, controlled=60.0, settle=20.0)
TASK = RunTask(
    name="one", disturb=("noise:level=0.5",), config=Config(), controlled=True, phase=0, seed=1, timing=TIMING
)


@pytest.fixture
def campaign() -> Campaign:
    timing = Spans(averages=False, lead_in=1.2, controlled=60.0, settle=20.0)
    return Campaign(scenarios=SCENARIOS, bundle=make_bundle(), config=Config(), timing=timing, phases=2)


@pytest.fixture
def worker(monkeypatch) -> Worker:
    return Worker(monkeypatch, **{"noise_0.5": 0.85, "gust": 0.95})


def test_every_scenario_runs_from_every_phase(campaign, worker, tmp_path) -> None:
    result = conduct(campaign, CampaignFolder(tmp_path / "c"), workers=1)
    assert worker.ran == [
        *("uncontrolled.phase0", "undisturbed.phase0", "uncontrolled.phase1", "undisturbed.phase1"),
        *("noise_0.5.phase0", "noise_0.5.phase1"),
        # The gust changes the flow, so it is held against that flow without control.
        *("gust.uncontrolled.phase0", "gust.phase0", "gust.uncontrolled.phase1", "gust.phase1"),
    ]
    assert [row.scenario.name for row in result.rows] == ["undisturbed", "noise_0.5", "gust"]
    assert [row.reduction.mean for row in result.rows] == pytest.approx([20.0, 15.0, 5.0])
    assert (result.made, result.kept, result.safe) == (10, 0, True)


def test_another_body_begins_in_its_own_wake_and_is_held_against_that(campaign, worker, tmp_path) -> None:
    box = scenario_of("box", disturb=("noise:level=0.5", "body:length=1"), settings=("ecu.hold_periods=2",))
    folder = CampaignFolder(tmp_path / "c")
    conduct(replace(campaign, scenarios=(SCENARIOS[0], box)), folder, workers=1)
    assert worker.ran[4:] == ["box.uncontrolled.phase0", "box.phase0", "box.uncontrolled.phase1", "box.phase1"]
    trucks, boxes = [worker.started[name] for name in worker.ran[:4]], [worker.started[name] for name in worker.ran[4:]]
    assert len({id(state) for state in trucks}) == len({id(state) for state in boxes}) == 1
    assert trucks[0] is not boxes[0]
    assert {path.name for path in folder.start(0).parent.iterdir()} == {
        f"{plant}phase_{phase}.npz" for plant in ("", "box.") for phase in range(2)
    }


@pytest.mark.slow
def test_a_stopped_campaign_goes_on_and_runs_again_what_changed_or_did_not_finish(campaign, worker, tmp_path) -> None:
    folder, seen = CampaignFolder(tmp_path / "c"), []
    for worker.stop_after, finished in ((0, 0), (5, 5)):
        with pytest.raises(KeyboardInterrupt):
            conduct(campaign, folder, workers=1)
        assert (folder.finished, folder.path.exists()) == (finished, finished > 0)
    worker.stop_after, worker.failing = 10**6, "noise_0.5.phase1"
    failed = conduct(campaign, folder, workers=1, progress=lambda *of: seen.append(of))
    assert len(worker.ran) == len(set(worker.ran)) == 10
    assert (failed.made, failed.kept, failed.safe) == (5, 5, False)
    assert failed.rows[1].broken == ["phase 1: did not finish: it fell over"]
    assert (seen[0], seen[-1]) == ((5, 10, ""), (10, 10, "gust.phase1"))
    worker.failing = ""
    louder = replace(SCENARIOS[1], disturb=("noise:level=0.6",))
    for changed, again in (
        (campaign, ["noise_0.5.phase1"]),
        (campaign, []),
        (replace(campaign, scenarios=(SCENARIOS[0], louder)), ["noise_0.5.phase0", "noise_0.5.phase1"]),
    ):
        worker.ran.clear()
        assert conduct(changed, folder, workers=1).safe
        assert worker.ran == again
    # A campaign that replaces another keeps the runs that they share.
    fewer = replace(campaign, phases=1, scenarios=SCENARIOS[::2])
    folder.check(fewer.label(), overwrite=True)
    assert conduct(fewer, folder, workers=1).kept == 4
    assert worker.ran == again
    folder.check(fewer.label(), overwrite=False)
    assert folder.finished == 4


def test_a_campaign_that_replaces_another_takes_no_start_of_other_phases(campaign, worker, tmp_path) -> None:
    folder = CampaignFolder(tmp_path / "c")
    for one in (campaign, campaign, replace(campaign, phases=1)):
        conduct(one, folder, workers=1)
    assert worker.kept == [None, folder, None]


def test_what_no_run_could_have_is_refused_before_any(campaign, short_release) -> None:
    campaign = replace(campaign, bundle=bundle.load(short_release))
    for wrong in (
        scenario_of("wrong", disturb=("dead:sensor=upper_00",)),
        scenario_of("wrong", disturb=("noize:level=1",)),
        scenario_of("wrong", settings=("bus.interface=virtual",)),
        scenario_of("wrong", settings=("vehicle.actuator_delay=300",)),
    ):
        with pytest.raises(ConfigError, match="scenario 'wrong': "):
            replace(campaign, scenarios=(*SCENARIOS, wrong)).check()
    with pytest.raises(StillwakeError, match=r"--settle 59\.9: must be at most 59\.8"):
        replace(campaign, timing=replace(campaign.timing, settle=59.9)).check()
    replace(campaign, timing=replace(campaign.timing, settle=59.8)).check()
    campaign.check()


def test_a_scenarios_settings_go_on_top_and_a_wrong_one_is_refused_with_its_name() -> None:
    base = Config(ecu=EcuConfig(hold_periods=2))
    config = settings_of(scenario_of("late", settings=("ecu.delay_steps=12", "bus.background.load=0.9")), base)
    assert (config.ecu.delay_steps, config.ecu.hold_periods, config.bus.background.load) == (12, 2, 0.9)
    assert settings_of(scenario_of("none"), base) == base
    box = settings_of(scenario_of("box", disturb=("body:length=1",), settings=("flow.substeps=45",)), base)
    square = replace(base.body, length=1.0, leading_edge_radius=0.0)
    assert box == replace(base, body=square, flow=replace(base.flow, substeps=45))
    for text in ["ecu.delay=1", "ecu.delay_steps=-1", "flow.action_limit=0.1", "train.epochs=3", "nonsense"]:
        with pytest.raises(ConfigError, match="scenario 'wrong': "):
            settings_of(scenario_of("wrong", settings=(text,)), Config())


def test_whatever_decides_a_run_is_in_its_key_and_its_name_is_not() -> None:
    changes: list[dict[str, Any]] = [{}, {"disturb": ("noise:level=0.6",)}, {"controlled": False}, {"seed": 2}]
    changes += [{"config": Config(ecu=EcuConfig(delay_steps=1))}, {"timing": replace(TIMING, settle=30.0)}]
    keys = [replace(TASK, **change).key("b", "s", "1") for change in changes]
    keys += [TASK.key(*others) for others in (("c", "s", "1"), ("b", "t", "1"), ("b", "s", "2"))]
    assert len(set(keys)) == len(keys)
    assert replace(TASK, name="other").key("b", "s", "1") == keys[0]
    seeds = {seed_of(seed, name, phase) for seed in (0, 1) for name in ("a", "b") for phase in range(3)}
    assert len(seeds) == 12 and all(0 <= seed < 2**32 for seed in seeds)


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
