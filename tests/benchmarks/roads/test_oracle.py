"""The oracle on problems whose best plan is known."""

from typing import Any

import numpy as np
import pytest

from benchmarks.roads.oracle import Oracle, descend, drive
from contract.config.controller import CostWeights, MpcConfig
from wake.plant.sample import Sample
from wake.truck.state import State

WEIGHTS = CostWeights(drag_fluctuation=0.0, lift=0.0, smoothness=0.0)


class Valley:
    """Drag (a - best)^2 of the action at the end of a period, and nothing else."""

    def __init__(self, best: float) -> None:
        self.best, self.action, self.step, self.advances = best, 0.0, 0, 0

    def state(self) -> State:
        return State(flat=np.zeros(1), substep=self.step, action=self.action)

    def reset(self, state: State) -> Sample:
        self.step, self.action = state.substep, state.action
        return self.sample()

    def advance(self, action: float) -> Sample:
        self.action, self.step, self.advances = action, self.step + 1, self.advances + 1
        return self.sample()

    def sample(self) -> Sample:
        return Sample(
            t=0.2 * self.step,
            Cp=np.zeros(1),
            Cd=(self.action - self.best) ** 2,
            Cl=0.0,
            Cd_slot_pressure=0.0,
            Cd_slot_viscous=0.0,
            Cd_momentum=0.0,
            jet_power=0.0,
            Uy_probe=0.0,
            action=self.action,
        )


def oracle(**changed: Any) -> Oracle:
    given: dict[str, Any] = dict(
        knots=(2, 4, 6),
        every=2,
        difference=1e-4,
        steps=(0.002, 0.01),
        iterations=3,
        limit=0.075,
        mpc=MpcConfig(weights=WEIGHTS),
    )
    return Oracle(**{**given, **changed})


@pytest.mark.parametrize("best", [0.03, -0.05])
def test_it_finds_the_best_action_and_stays_there(best, tmp_path):
    plant = Valley(best)
    start = plant.state()
    rows = drive(plant, oracle(), 60, lambda sample: [sample.t, sample.action], tmp_path / "run.npz", start)
    assert rows.shape == (60, 2) and rows[:, 0] == pytest.approx(0.2 * np.arange(60))
    assert np.abs(rows[-20:, 1] - best).max() < 0.004


def test_beyond_the_bound_it_stays_on_it(tmp_path):
    plant = Valley(0.2)
    rows = drive(plant, oracle(), 60, lambda sample: [sample.action], tmp_path / "run.npz", plant.state())
    assert rows[-10:, 0] == pytest.approx(0.075)


def test_descent_is_never_worse_and_reaches_a_quadratic_s_minimum():
    centre = np.array([0.02, -0.03, 0.05])
    curvature = np.diag([1.0, 3.0, 2.0])

    def cost(values: np.ndarray) -> float:
        return float((values - centre) @ curvature @ (values - centre))

    values, found = np.zeros(3), [cost(np.zeros(3))]
    for _ in range(60):
        values = descend(cost, values, difference=1e-6, steps=(0.0005, 0.002, 0.01), iterations=1, limit=0.075)
        found.append(cost(values))
    assert np.all(np.diff(found) <= 0.0)
    assert values == pytest.approx(centre, abs=2e-3)


def test_a_plan_shifted_is_the_same_plan_later():
    one = oracle(knots=(2, 4, 8), every=2)
    values = np.array([0.02, -0.04, 0.06])
    actions = one.actions(values, 0.01)
    assert actions == pytest.approx([0.015, 0.02, -0.01, -0.04, -0.015, 0.01, 0.035, 0.06])
    later = one.actions(one.shifted(values, 0.01), float(actions[1]))
    # Where a new knot falls between two old ones the line is another one; at the knots it is the plan, then flat.
    assert later[[1, 3, 7]] == pytest.approx([actions[3], actions[5], actions[7]])


def test_planning_leaves_the_plant_where_it_was():
    plant = Valley(0.03)
    plant.advance(0.01)
    before = plant.state()
    one = oracle(iterations=1)
    advances = plant.advances
    one.planned(plant, np.zeros(3))
    assert (plant.step, plant.action) == (before.substep, before.action)
    assert plant.advances - advances == one.rollouts * one.horizon


def test_a_stopped_run_goes_on_as_if_it_had_not_been(tmp_path):
    def rows(name: str, periods: int) -> np.ndarray:
        plant = Valley(0.03)
        return drive(plant, oracle(), periods, lambda sample: [sample.t, sample.action], tmp_path / name, plant.state())

    rows("stopped.npz", 20)
    assert np.array_equal(rows("stopped.npz", 40), rows("whole.npz", 40))
