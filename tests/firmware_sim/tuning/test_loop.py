"""Runs of the search go through the whole loop, with the settings that are to be tried."""

from dataclasses import replace

import pytest

from contract.config.controller import CostWeights, MpcConfig
from contract.config.tree import Config
from contract.errors import PlantError
from firmware_sim.bench.spans import Spans
from firmware_sim.tuning.loop import WakeRuns, blocks_in
from firmware_sim.tuning.score import Goal
from tests.firmware_sim.bench.harness import LiveOscillator, Waves
from tests.firmware_sim.conftest import make_bundle

SPANS = Spans(lead_in=15.0, controlled=40.0, settle=20.0)


class Heard(Waves):
    """Keeps the weights that the ECU gives it."""

    weights: tuple[float, ...] = ()

    def control_step(self, window, plan, free, weights=None):
        assert weights is not None
        self.weights = tuple(weights)
        return super().control_step(window, plan, free, weights)


def runs_with(controller) -> WakeRuns:
    config = Config()
    wake_at, made = lambda phase: LiveOscillator(config), lambda mpc: controller
    return WakeRuns(make_bundle(), config, wake_at=wake_at, spans=SPANS, goal=Goal(), controller=made)


def settings() -> MpcConfig:
    return replace(make_bundle().manifest.mpc, weights=CostWeights(lift=0.123, rate=4.5))


def test_the_ecu_plans_with_the_weights_that_are_tried() -> None:
    controller, seen, periods = Heard(), [], []
    figures = runs_with(controller)(
        settings(), 0, lambda block, score: seen.append(block), lambda done, total: periods.append((done, total))
    )
    assert controller.weights == pytest.approx(settings().weights.as_tuple())
    assert figures.trouble is None
    assert figures.rms_action is not None and figures.rms_action > 0.0
    assert seen == [0, 1, 2, 3] and blocks_in(SPANS.controlled) == 4
    assert periods[-1] == (275, 275)


def test_a_run_that_is_given_up_ends_with_its_block() -> None:
    periods = []

    def give_up(block: int, score: float) -> None:
        raise RuntimeError(block)

    with pytest.raises(RuntimeError, match="0"):
        runs_with(Heard())(settings(), 0, give_up, lambda done, total: periods.append(done))
    # 15 t_c without control and a block of 10, 0.2 each.
    assert periods[-1] == 125


def test_a_flow_that_diverges_is_trouble(monkeypatch) -> None:
    def diverges(*_arguments, **_named) -> None:
        raise PlantError("the flow diverged at t = 12.4")

    monkeypatch.setattr("firmware_sim.tuning.loop.simulate", diverges)
    figures = runs_with(Heard())(settings(), 0, lambda block, score: None)
    assert (figures.trouble, figures.reduction_percent) == ("the flow diverged at t = 12.4", None)
