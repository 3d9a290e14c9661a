"""The oracle and foresight on plants whose best action is known."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.roads import foresight
from benchmarks.roads.foresight import Foresight
from benchmarks.roads.oracle import Oracle, drive
from contract.config.controller import CostWeights, MpcConfig
from tests.benchmarks.roads.plants import Repaying, Valley
from wake.recording.feedback import NoFeedback

WEIGHTS = CostWeights(drag_fluctuation=0.0, lift=0.0, smoothness=0.0)
ORACLE = Oracle(
    knots=(2, 4, 6),
    every=2,
    difference=1e-4,
    steps=(0.002, 0.01),
    iterations=3,
    limit=0.075,
    mpc=MpcConfig(weights=WEIGHTS),
)


def planned(best: float, kept: Path, periods: int = 60) -> np.ndarray:
    plant = Valley(best)
    return drive(plant, ORACLE, periods, lambda sample: [sample.action], kept, plant.state())[:, 0]


def test_the_oracle_finds_the_best_action_within_the_bound(tmp_path):
    for best in (0.03, -0.05):
        assert np.abs(planned(best, tmp_path / f"{best}.npz")[-20:] - best).max() < 0.004, best
    assert planned(0.2, tmp_path / "bound.npz")[-10:] == pytest.approx(0.075)


def test_a_stopped_oracle_goes_on_as_if_it_had_not_been_stopped(tmp_path):
    planned(0.03, tmp_path / "stopped.npz", 20)
    assert np.array_equal(planned(0.03, tmp_path / "stopped.npz", 40), planned(0.03, tmp_path / "whole.npz", 40))


def looked_ahead(horizon: int, kept: Path, **given: Any) -> np.ndarray:
    plant, offsets = Repaying(), (0.0, -0.03, 0.03)
    looking = Foresight(policy=NoFeedback(), offsets=offsets, every=5, horizon=horizon, limit=0.075)
    return foresight.drive(plant, looking, 60, kept, plant.state(), **given)[:, -1]


def test_only_a_horizon_that_sees_the_repayment_takes_the_kick(tmp_path):
    actions = looked_ahead(30, tmp_path / "long.npz")
    kicks = np.flatnonzero(np.abs(actions) > 0.0)
    assert actions.max() == pytest.approx(0.03) and actions.min() == 0.0
    assert len(kicks) == 5 and kicks[-1] - kicks[0] == 4
    assert not looked_ahead(10, tmp_path / "short.npz").any()

    def stop(done: int, of: int) -> None:
        if done >= 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        looked_ahead(30, tmp_path / "stopped.npz", progress=stop)
    assert np.array_equal(looked_ahead(30, tmp_path / "stopped.npz"), actions)
