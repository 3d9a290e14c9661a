"""Single runs on the real wake, for a few periods."""

from dataclasses import replace

import numpy as np
import pytest

from contract.config.tree import Config
from contract.errors import ConfigError
from contract.release import bundle
from contract.runtime.onnx_session import OnnxController
from firmware_sim.campaign import running
from firmware_sim.campaign.outcome import Course, Figures, Outcome, Service
from firmware_sim.campaign.running import check_run, flow_disturbances, run_task
from firmware_sim.campaign.task import Task, Timing
from tests.firmware_sim.campaign.conftest import scenario_of
from wake.truck.state import developed_state

pytestmark = pytest.mark.slow  # runs of the real wake

TIMING = Timing(lead_in=1.2, controlled=1.6, settle=0.8)
LEAD_IN, PERIODS = 6, 14


@pytest.fixture(scope="module")
def release(short_release, shared_wake) -> bundle.Bundle:
    return bundle.load(short_release)


def task_of(*disturb: str, controlled: bool = True, seed: int = 1) -> Task:
    return Task(name="one", disturb=disturb, config=Config(), controlled=controlled, phase=0, seed=seed, timing=TIMING)


def course_of(outcome: Outcome) -> Course:
    assert outcome.course is not None, outcome.failure
    return outcome.course


def figures_of(outcome: Outcome) -> Figures:
    assert outcome.figures is not None, outcome.failure
    return outcome.figures


def service_of(outcome: Outcome) -> Service:
    assert outcome.service is not None, outcome.failure
    return outcome.service


@pytest.fixture(scope="module")
def undisturbed(release):
    return run_task(task_of(), release, developed_state())


def test_a_run_without_control_is_the_solver_by_itself(release, shared_wake) -> None:
    free = run_task(task_of(controlled=False), release, developed_state())
    shared_wake.reset(replace(developed_state(), substep=0, action=0.0))
    drag = [shared_wake.sample().Cd, *(shared_wake.advance(0.0).Cd for _ in range(PERIODS - 1))]
    assert course_of(free).Cd == pytest.approx(drag, abs=1e-6)
    # Averaged from 0.8 t_c after the request at 1.2 t_c on: the last four samples.
    assert figures_of(free).Cd == pytest.approx(np.mean(drag[-4:]), abs=1e-6)
    assert free.service is None


def test_before_the_request_a_run_under_control_is_the_one_without(release, undisturbed) -> None:
    free = run_task(task_of(controlled=False), release, developed_state())
    assert course_of(undisturbed).enabled_t == pytest.approx(1.2)
    assert course_of(undisturbed).Cd[: LEAD_IN + 1] == course_of(free).Cd[: LEAD_IN + 1]
    assert course_of(undisturbed).Cd != course_of(free).Cd
    assert not any(course_of(undisturbed).action[: LEAD_IN + 1])
    assert any(course_of(undisturbed).action)


def test_an_undisturbed_run_breaks_nothing_and_is_in_control(undisturbed) -> None:
    service = service_of(undisturbed)
    assert (service.violations, service.broken, undisturbed.failure) == (0, [], "")
    assert service.in_control == service.requested > 0
    assert service.latches == 0


def test_the_same_seed_gives_the_same_run_and_another_one_another(release) -> None:
    first, again, other = (
        run_task(task_of("noise:level=0.5", seed=seed), release, developed_state()) for seed in (1, 1, 2)
    )
    assert first == again
    assert course_of(first).action != course_of(other).action


def test_a_disturbance_of_the_flow_also_acts_without_control(release) -> None:
    still, windy = (
        run_task(task_of(*disturb, controlled=False), release, developed_state())
        for disturb in ((), ("gust:amplitude=0.1,period=2.8",))
    )
    assert course_of(still).Cd != course_of(windy).Cd


def test_lost_pressures_latch_and_are_counted(release) -> None:
    outcome = run_task(task_of("vehicle:drop:probability=1@0.18.."), release, developed_state())
    assert service_of(outcome).latches == 1
    assert service_of(outcome).in_control < service_of(outcome).requested
    assert "STREAM_LOST" in service_of(outcome).reasons
    assert service_of(outcome).violations == 0


def test_what_is_raised_in_a_run_is_its_outcome(release, monkeypatch) -> None:
    def diverged(*_arguments: object) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(running, "_under_control", diverged)
    outcome = run_task(task_of(), release, developed_state())
    assert outcome.failure == "ZeroDivisionError: by nothing"
    assert outcome.figures is None


def test_an_invariant_that_breaks_is_said_with_its_period(release, monkeypatch) -> None:
    # A vehicle that drives its jets whatever the command says.
    from firmware_sim.bench.vehicle_node import Actuation, VehicleNode

    honest = VehicleNode.apply_commands

    def driven(self, frames) -> Actuation:
        return replace(honest(self, frames), action=0.01)

    monkeypatch.setattr(VehicleNode, "apply_commands", driven)
    outcome = run_task(task_of(), release, developed_state())
    assert service_of(outcome).violations > 0
    assert service_of(outcome).broken[0].startswith("period ")
    assert any("jets_request" in text for text in service_of(outcome).broken)


def test_only_what_acts_on_the_flow_is_left_without_control() -> None:
    texts = ("noise:level=0.5", "gust:amplitude=0.1,period=20", "ecu:drop:probability=0.1", "reynolds=700")
    kept = flow_disturbances(texts)
    assert [text.partition(":")[0].partition("=")[0] for text in kept] == ["gust", "reynolds"]
    assert flow_disturbances(kept) == kept


def test_a_disturbance_that_could_not_act_is_refused_with_its_scenario(release) -> None:
    for text, says in [
        ("noize:level=1", "noize"),
        ("noise:level=0.5@9..", "when the run has ended"),
        ("dead:sensor=upper_00", "upper_00 is not in use"),
        ("ecu:drop:probability=2", "probability"),
    ]:
        with pytest.raises(ConfigError, match=rf"scenario 'wrong': .*{says}"):
            check_run(scenario_of("wrong", disturb=(text,)), Config(), release, TIMING, OnnxController.of(release))
