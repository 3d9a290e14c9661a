"""A campaign's runs: what is run and what is kept; the runs themselves are made up here."""

from dataclasses import replace

import pytest

from contract.config.tree import Config
from contract.errors import ConfigError, StillwakeError
from contract.release import bundle
from firmware_sim.bench.spans import Spans
from firmware_sim.campaign.conduct import Campaign, conduct
from firmware_sim.campaign.folder import CampaignFolder
from tests.firmware_sim.campaign.conftest import Worker, scenario_of

SCENARIOS = (
    scenario_of("undisturbed"),
    scenario_of("noise_0.5", "A", disturb=("noise:level=0.5",)),
    scenario_of("gust", "B", disturb=("gust:amplitude=0.1,period=20",)),
)


@pytest.fixture
def campaign(bundle_of) -> Campaign:
    timing = Spans(averages=False, lead_in=1.2, controlled=60.0, settle=20.0)
    return Campaign(scenarios=SCENARIOS, bundle=bundle_of(), config=Config(), timing=timing, phases=2)


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


@pytest.mark.slow
def test_a_campaign_that_is_stopped_goes_on_and_a_whole_one_runs_nothing(campaign, worker, tmp_path) -> None:
    folder = CampaignFolder(tmp_path / "c")
    worker.stop_after = 0
    with pytest.raises(KeyboardInterrupt):
        conduct(campaign, folder, workers=1)
    assert list(tmp_path.iterdir()) == []
    worker.stop_after = 5
    with pytest.raises(KeyboardInterrupt):
        conduct(campaign, folder, workers=1)
    assert folder.finished == 5
    worker.stop_after = 10**6
    first = conduct(campaign, folder, workers=1)
    assert len(worker.ran) == len(set(worker.ran)) == 10
    assert (first.made, first.kept) == (5, 5)
    worker.ran.clear()
    second = conduct(campaign, folder, workers=1)
    assert worker.ran == []
    assert (second.rows, second.kept) == (first.rows, 10)


def test_only_what_changed_or_did_not_finish_is_run_again(campaign, worker, tmp_path) -> None:
    folder = CampaignFolder(tmp_path / "c")
    worker.failing = "noise_0.5.phase1"
    result = conduct(campaign, folder, workers=1)
    assert not result.safe
    assert result.rows[1].broken == ["phase 1: did not finish: it fell over"]
    worker.failing = ""
    worker.ran.clear()
    assert conduct(campaign, folder, workers=1).safe
    assert worker.ran == ["noise_0.5.phase1"]
    worker.ran.clear()
    louder = replace(SCENARIOS[1], disturb=("noise:level=0.6",))
    conduct(replace(campaign, scenarios=(SCENARIOS[0], louder, SCENARIOS[2])), folder, workers=1)
    assert worker.ran == ["noise_0.5.phase0", "noise_0.5.phase1"]


def test_a_campaign_that_replaces_another_keeps_the_runs_they_share(campaign, worker, tmp_path) -> None:
    folder, seen = CampaignFolder(tmp_path / "c"), []
    conduct(campaign, folder, workers=1, progress=lambda *of: seen.append(of))
    assert (seen[0], seen[-1]) == ((0, 10, ""), (10, 10, "gust.phase1"))
    assert [done for done, _, _ in seen] == sorted(done for done, _, _ in seen)
    worker.ran.clear()
    fewer = replace(campaign, phases=1)
    folder.check(fewer.label(), overwrite=True)
    assert conduct(fewer, folder, workers=1).kept == 5
    assert worker.ran == []
    folder.check(fewer.label(), overwrite=False)
    assert folder.finished == 5


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
