"""Rows of the table of roads: averages that are known in closed form, tuning, and the reward of learning."""

from importlib.util import find_spec

import numpy as np
import pytest
import torch

from benchmarks.roads import measure
from benchmarks.roads.baselines import Formula, tuned
from benchmarks.roads.calm_tuning import weights_of
from benchmarks.roads.laws import Constant
from benchmarks.roads.listing import ROADS
from benchmarks.roads.loop import SPANS
from benchmarks.roads.rl_env import reward
from benchmarks.roads.row import outcome_of_series
from contract.errors import StillwakeError

ENABLED = 125


def series() -> dict[str, np.ndarray]:
    """25 t_c of lift sin(2 pi 0.2 t) and drag 1; then lift 0.1 + 0.3 sin, drag 0.75, action 0.05 sin."""
    t = 0.2 * np.arange(625)
    wave, under, zero = np.sin(2.0 * np.pi * 0.2 * t), np.arange(625) > ENABLED, np.zeros(625)
    return {
        "t": t,
        "Cd": np.where(under, 0.75, 1.0),
        "Cl": np.where(under, 0.1 + 0.3 * wave, wave),
        "Cd_slot_pressure": zero + 0.05,
        "Cd_slot_viscous": zero - 0.01,
        "Cd_momentum": np.where(under, -0.02, 0.0),
        "jet_power": np.where(under, 0.04, 0.0),
        "action": np.where(under, 0.05 * wave, 0.0),
    }


def test_averages_of_a_sine_are_the_integrals():
    outcome = outcome_of_series(series(), ENABLED, SPANS.settle)
    assert (outcome.Cd_uncontrolled, outcome.Cd) == pytest.approx((1.0, 0.75))
    assert (outcome.Cd_net_uncontrolled, outcome.Cd_net) == pytest.approx((1.04, 0.77))
    assert outcome.reduction_percent == pytest.approx(25.0)
    assert outcome.net_reduction_percent == pytest.approx(100.0 * (1.0 - 0.77 / 1.04))
    assert outcome.mean_Cl == pytest.approx(0.1, abs=1e-6)
    # The mean of |0.1 + 0.3 sin| in closed form; 25 samples a cycle leave 1 % at its kinks.
    s = np.arcsin(1.0 / 3.0)
    assert outcome.abs_Cl == pytest.approx(2.0 / np.pi * (0.1 * s + 0.3 * np.cos(s)), rel=0.01)
    assert (outcome.rms_action, outcome.jet_power) == pytest.approx((0.05 / np.sqrt(2.0), 0.04), rel=1e-3)


def test_what_comes_before_the_settling_time_does_not_count():
    values = series()
    values["Cd"][ENABLED + 1 : ENABLED + 200] = 9.0
    assert outcome_of_series(values, ENABLED, SPANS.settle).Cd == pytest.approx(0.75)


def test_the_neighbours_of_the_best_of_a_grid_are_tried_too():
    formula = Formula(
        title="one",
        make=lambda constants, config, release: Constant(action=constants["gain"]),
        grid=[{"gain": gain, "delay": delay} for gain in (-0.1, 0.1) for delay in (0.0, 6.0)],
        products=0,
        scaled=("gain", (0.3, 3.0)),
    )
    ranked = tuned(formula, lambda constants: (constants["gain"] - 0.28) ** 2 + 0.01 * constants["delay"], "one")
    assert ranked[0] == {"gain": pytest.approx(0.3), "delay": 0.0}
    assert ranked[1] == {"gain": 0.1, "delay": 0.0} and len(ranked) == 6


def test_windows_weigh_by_one_over_their_lift():
    lift = torch.tensor([[0.0, 0.1, -1.9], [0.0, -0.3, 1.9]])
    forces = torch.stack([torch.full_like(lift, 7.0), lift], dim=-1)
    # Means 0, 0.2 and 1.9 of |Cl|: 10, 10/3 and 1/2.
    expected = np.array([10.0, 10.0 / 3.0, 0.5])
    assert weights_of(forces).numpy() == pytest.approx(expected / expected.mean(), rel=1e-5)


def test_the_reward_is_the_drag_saved_less_the_price_of_lift():
    assert reward({"Cd_net": 0.9, "jet_power": 0.05, "Cl": -0.3}) == pytest.approx(1.07 - 0.9 - 0.05 - 0.2 * 0.3)


def test_a_new_row_takes_the_place_of_its_road_and_others_stay():
    names = list(ROADS)
    before = [{"road": name, "Cd": 1.0} for name in (names[2], names[0], "of another version")]
    merged = measure.merged(before, [{"road": names[2], "Cd": 0.5}, {"road": names[1], "Cd": 1.0}])
    assert [row["road"] for row in merged] == [*names[:3], "of another version"] and merged[2]["Cd"] == 0.5
    for module in set(ROADS.values()):
        assert find_spec(f"benchmarks.roads.{module}") is not None, module
    with pytest.raises(StillwakeError, match="no road 'motorway': one of no-control, steady"):
        measure.checked(["no-control", "motorway"])
