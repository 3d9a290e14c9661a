"""Rows: averages of series that are known in closed form, and the arithmetic on them."""

import numpy as np
import pytest

from benchmarks.roads.loop import SPANS
from benchmarks.roads.row import Outcome, Row, outcome_of_series

PERIOD = 0.2


def series(frequency: float = 0.2) -> tuple[dict[str, np.ndarray], int]:
    """25 t_c of lift sin(2 pi f t) and drag 1; then lift 0.1 + 0.3 sin, drag 0.75, action 0.05 sin."""
    t = PERIOD * np.arange(625)
    enabled = 125
    wave, under = np.sin(2.0 * np.pi * frequency * t), np.arange(625) > enabled
    zero = np.zeros_like(t)
    return {
        "t": t,
        "Cd": np.where(under, 0.75, 1.0),
        "Cl": np.where(under, 0.1 + 0.3 * wave, wave),
        "Cd_slot_pressure": zero + 0.05,
        "Cd_slot_viscous": zero - 0.01,
        "Cd_momentum": np.where(under, -0.02, 0.0),
        "jet_power": np.where(under, 0.04, 0.0),
        "action": np.where(under, 0.05 * wave, 0.0),
    }, enabled


def test_averages_of_a_sine_are_the_integrals():
    values, enabled = series()
    found = outcome_of_series(values, enabled, SPANS.settle)
    assert found.Cd_uncontrolled == pytest.approx(1.0) and found.Cd == pytest.approx(0.75)
    assert found.Cd_net_uncontrolled == pytest.approx(1.04) and found.Cd_net == pytest.approx(0.77)
    assert found.reduction_percent == pytest.approx(25.0)
    assert found.net_reduction_percent == pytest.approx(100.0 * (1.0 - 0.77 / 1.04))
    assert found.mean_Cl == pytest.approx(0.1, abs=1e-6)
    # The mean of |0.1 + 0.3 sin| in closed form; 25 samples a cycle leave 1 % at its kinks.
    s = np.arcsin(1.0 / 3.0)
    assert found.abs_Cl == pytest.approx(2.0 / np.pi * (0.1 * s + 0.3 * np.cos(s)), rel=0.01)
    assert found.rms_action == pytest.approx(0.05 / np.sqrt(2.0), rel=1e-3)
    assert found.jet_power == pytest.approx(0.04)


def test_what_comes_before_the_settling_time_does_not_count():
    values, enabled = series()
    values["Cd"][enabled + 1 : enabled + 200] = 9.0
    assert outcome_of_series(values, enabled, SPANS.settle).Cd == pytest.approx(0.75)


def outcome(Cd: float, **changed: object) -> Outcome:
    given = dict(
        Cd_uncontrolled=1.0,
        Cd_net_uncontrolled=1.1,
        Cd=Cd,
        Cd_net=Cd + 0.05,
        abs_Cl=0.2,
        mean_Cl=0.0,
        rms_action=0.03,
        jet_power=0.04,
    )
    return Outcome(**{**given, **changed})


def test_a_row_has_mean_and_span_over_the_phases():
    row = Row(
        road="one",
        title="one",
        kind="baseline",
        outcomes=(outcome(0.7), outcome(0.8), outcome(0.9)),
        sensors=4,
        loop="CAN",
        mesh=(443, 164),
    )
    tree = row.as_tree()
    assert tree["reduction_percent"] == pytest.approx(20.0) and tree["phases"] == 3
    assert (tree["least_reduction_percent"], tree["most_reduction_percent"]) == pytest.approx((10.0, 30.0))
    assert tree["Cd"] == pytest.approx(0.8) and tree["Cd_net"] == pytest.approx(0.85)
    assert tree["net_reduction_percent"] == pytest.approx(100.0 * (1.0 - 0.85 / 1.1))
