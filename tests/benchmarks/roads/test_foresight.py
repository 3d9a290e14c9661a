"""Roll-outs of a plant whose best kick is known: it costs drag at once and repays it later."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.roads.foresight import Foresight, drive
from wake.plant.sample import Sample
from wake.recording.feedback import NoFeedback
from wake.truck.state import State

REPAYS_AFTER = 12
"""Periods from a kick upwards to less drag."""


class Repaying:
    """Cd is 1, more while the jets act, and 0.5 for good some time after they blew upwards."""

    def __init__(self) -> None:
        self.step, self.action, self.kicked = 0, 0.0, -1.0

    def state(self) -> State:
        return State(flat=np.array([self.kicked]), substep=self.step, action=self.action)

    def reset(self, state: State) -> Sample:
        self.step, self.action, self.kicked = state.substep, state.action, float(state.flat[0])
        return self.sample()

    def advance(self, action: float) -> Sample:
        self.step, self.action = self.step + 1, action
        if action > 0.01 and self.kicked < 0:
            self.kicked = float(self.step)
        return self.sample()

    def sample(self) -> Sample:
        calm = 0.0 <= self.kicked <= self.step - REPAYS_AFTER
        numbers = dict.fromkeys(
            ("Cl", "Cd_slot_pressure", "Cd_slot_viscous", "Cd_momentum", "jet_power", "Uy_probe"), 0.0
        )
        Cd = (0.5 if calm else 1.0) + 5.0 * abs(self.action)
        return Sample(t=0.2 * self.step, Cp=np.zeros(1), Cd=Cd, action=self.action, **numbers)


def looking(horizon: int) -> Foresight:
    return Foresight(policy=NoFeedback(), offsets=(0.0, -0.03, 0.03), every=5, horizon=horizon, limit=0.075)


def driven(horizon: int, kept: Path, periods: int = 60, **given: Any) -> Any:
    plant = Repaying()
    return drive(plant, looking(horizon), periods, kept, plant.state(), **given)


def test_a_horizon_that_sees_the_repayment_takes_the_kick_once(tmp_path):
    actions = driven(30, tmp_path / "run.npz")[:, -1]
    kicks = np.flatnonzero(np.abs(actions) > 0.0)
    assert actions.max() == pytest.approx(0.03) and actions.min() == 0.0
    assert len(kicks) == 5 and kicks[-1] - kicks[0] == 4


def test_a_horizon_that_ends_before_it_does_nothing(tmp_path):
    assert not driven(10, tmp_path / "run.npz")[:, -1].any()


def test_a_choice_leaves_the_plant_where_it_was():
    plant, foresight = Repaying(), looking(30)
    plant.advance(0.004)
    before = plant.state()
    offset, forecast = foresight.choice(plant, foresight.policy.start())
    assert (plant.state().substep, plant.state().action) == (before.substep, before.action)
    assert offset == 0.03 and forecast < foresight.forecast(plant, before, foresight.policy.start(), 0.0)


def test_a_stopped_run_goes_on_as_if_it_had_not_been_stopped(tmp_path):
    whole = driven(30, tmp_path / "whole.npz")

    def stop(done: int, of: int) -> None:
        if done >= 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        driven(30, tmp_path / "run.npz", progress=stop)
    assert np.array_equal(driven(30, tmp_path / "run.npz"), whole)
