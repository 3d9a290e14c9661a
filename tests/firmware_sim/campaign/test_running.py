"""Runs of a campaign on the real wake, for a few periods: one by one, and on dask workers."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract import side_by_side
from contract.config.body import BodyConfig
from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.release import bundle
from contract.release.checks import Bundle
from firmware_sim.bench.simulation import Spans
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.campaign import conduct as conducting
from firmware_sim.campaign.conduct import Campaign, RunTask, conduct, flow_disturbances, run_task
from firmware_sim.campaign.folder import CampaignFolder
from tests.firmware_sim.campaign.conftest import scenario_of
from wake.truck.develop import start_from_rest
from wake.truck.truck_wake import TruckWake

pytestmark = pytest.mark.slow  # runs of the solver
TIMING = Spans(averages=False, lead_in=1.2, controlled=1.6, settle=0.8)
LEAD_IN, PERIODS = 6, 14
ROUGH = ("noise:level=0.5", "ecu:drop:probability=0.3", "gust:amplitude=0.1,period=1")
ran: Any = run_task  # whose outcomes have results


@pytest.fixture(scope="module")
def release(short_release) -> Bundle:
    return bundle.load(short_release)


@pytest.fixture(scope="module")
def task_of(coarse):
    def made(*disturb, controlled=True):
        given: dict[str, Any] = {"config": Config(flow=coarse.flow), "controlled": controlled, "timing": TIMING}
        return RunTask(name="one", disturb=disturb, phase=0, seed=1, **given)

    return made


def test_a_run_without_control_is_the_solver_by_itself_and_control_begins_with_the_request(release, task_of, coarse):
    start = coarse.start
    free, undisturbed = (ran(task_of(controlled=controlled), release, start) for controlled in (False, True))
    with coarse.plant() as wake:
        drag = [wake.sample().Cd, *(wake.advance(0.0).Cd for _ in range(PERIODS - 1))]
    assert free.course.Cd == pytest.approx(drag, abs=1e-6)
    # Averaged from 0.8 t_c after the request at 1.2 t_c on: the last four samples.
    assert free.figures.Cd == pytest.approx(np.mean(drag[-4:]), abs=1e-6)
    assert free.service is None
    assert undisturbed.course.enabled_t == pytest.approx(1.2)
    assert undisturbed.course.Cd[: LEAD_IN + 1] == free.course.Cd[: LEAD_IN + 1]
    assert undisturbed.course.Cd != free.course.Cd
    assert not any(undisturbed.course.action[: LEAD_IN + 1])
    assert any(undisturbed.course.action)
    service = undisturbed.service
    assert (service.violations, service.broken, service.latches, undisturbed.failure) == (0, [], 0, "")
    assert service.in_control == service.requested > 0
    # A disturbance of the flow acts without control, too.
    assert free.course.Cd != ran(task_of("gust:amplitude=0.1,period=2.8", controlled=False), release, start).course.Cd


def test_what_is_raised_in_a_run_is_its_outcome(release, task_of, coarse, monkeypatch):
    def diverged(*_arguments: object):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(conducting, "_under_control", diverged)
    outcome = ran(task_of(), release, coarse.start)
    assert outcome.failure == "ZeroDivisionError: by nothing"
    assert outcome.figures is None


def test_an_invariant_that_breaks_is_reported_with_its_period(release, task_of, coarse, monkeypatch):
    # A vehicle that drives its jets whatever the command is.
    honest = VehicleNode.apply_commands
    monkeypatch.setattr(VehicleNode, "apply_commands", lambda self, frames: replace(honest(self, frames), action=0.01))
    service = ran(task_of(), release, coarse.start).service
    assert service.violations > 0
    assert service.broken[0].startswith("period ")
    assert any("jets_request" in text for text in service.broken)


def test_behind_another_body_the_loop_closes_and_a_plant_that_is_not_that_body_is_refused(release, task_of, coarse):
    task = replace(task_of("body:length=1"), timing=replace(TIMING, controlled=0.6, settle=0.0))
    flow = replace(task.config.flow, reynolds=100.0)
    square = replace(task, config=replace(task.config, flow=flow, body=BodyConfig(length=1.0, leading_edge_radius=0.0)))
    wake = TruckWake(square.config.flow, body=square.config.body)
    start_from_rest(wake)
    start = wake.state()
    free, under = (ran(replace(square, controlled=controlled), release, start) for controlled in (False, True))
    assert under.course.Cd[: LEAD_IN + 1] == free.course.Cd[: LEAD_IN + 1]
    assert under.service.violations == 0
    refused = ran(replace(task, disturb=("body:length=2",)), release, coarse.start)
    assert refused.failure == "disturbance 'body:length=2': the plant has a different body"
    assert "was built for another body" in ran(replace(square, disturb=()), release, start).failure


def test_only_what_acts_on_the_flow_is_left_without_control():
    texts = ("noise:level=0.5", "gust:amplitude=0.1,period=20", "ecu:drop:probability=0.1", "reynolds=700")
    kept = flow_disturbances((*texts, "body:length=1"))
    assert [text.partition(":")[0].partition("=")[0] for text in kept] == ["gust", "reynolds", "body"]
    assert flow_disturbances(kept) == kept


@pytest.fixture
def campaign(release, coarse, monkeypatch) -> Campaign:
    monkeypatch.setattr(
        conducting, "starting_states", lambda folder, config, phases, scenario, progress: (coarse.start,) * phases
    )
    scenarios = scenario_of("undisturbed"), scenario_of("rough", disturb=ROUGH)
    config, timing = Config(flow=coarse.flow), Spans(averages=False, lead_in=0.4, controlled=0.8, settle=0.2)
    return Campaign(scenarios=scenarios, bundle=release, config=config, timing=timing, phases=1, seed=3)


def files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*.json"))}


@pytest.mark.processes
def test_a_worker_writes_the_bytes_of_runs_in_this_process(campaign, tmp_path, monkeypatch) -> None:
    def here(tasks, call, *, finished, **_) -> None:
        for task in reversed(tasks):
            work, *given = call(task)
            finished(task, work(*given))

    campaign.check()
    together, alone = tmp_path / "together", tmp_path / "alone"
    by_workers = conduct(campaign, CampaignFolder(together), workers=1)
    monkeypatch.setattr(conducting, "spread", here)
    assert conduct(campaign, CampaignFolder(alone), workers=1).rows == by_workers.rows
    assert files(alone) == files(together)
    assert {"campaign.json", "runs/rough.phase0.json", "runs/rough.uncontrolled.phase0.json"} <= files(alone).keys()
    assert by_workers.safe


@pytest.mark.processes
def test_a_scheduler_that_is_not_there_is_an_error(campaign, tmp_path, monkeypatch) -> None:
    # dask asks again and again until then.
    monkeypatch.setattr(side_by_side, "_CONNECT_S", 1.0)
    monkeypatch.delattr(conducting, "starting_states")  # takes minutes, so it comes after this check
    with pytest.raises(StillwakeError, match="cannot reach scheduler"):
        conduct(campaign, CampaignFolder(tmp_path / "out"), workers=1, scheduler="tcp://127.0.0.1:1")
    assert not (tmp_path / "out").exists()
