"""Figures of a run against numbers worked out by hand."""

from math import isnan, sqrt

import pytest

from can_bridge.wire.messages import Mode
from firmware_sim.runs.statistics import latency, reduction_percent, regimes

NAN = float("nan")


def test_averages_before_and_after_settling(log_of):
    log = log_of(
        Cd=[1.0, 1.2, 9.0, 9.0, 0.8, 0.9],
        Cl=[-2.0, 1.0, 9.0, 9.0, 0.5, -0.1],
        Cd_slot_pressure=[0.3, 0.3, 9.0, 9.0, 0.25, 0.25],
        Cd_slot_viscous=[-0.2, -0.2, 9.0, 9.0, -0.05, -0.05],
        Cd_momentum=[0.0, 0.0, 9.0, 9.0, -0.3, -0.1],
        base_Cp=[-0.6, -0.8, 9.0, 9.0, -0.4, -0.5],
        action=[0.0, 0.0, 9.0, 9.0, 0.03, -0.04],
        jet_power=[0.0, 0.0, 9.0, 9.0, 0.01, 0.02],
        Uy_probe=[0.5, -0.5, 9.0, 9.0, 0.1, 0.1],
    )
    before, under = regimes(log, settle=0.4)
    assert (before.Cd, under.Cd) == pytest.approx((1.1, 0.85))
    assert (before.Cd_std, under.Cd_std) == pytest.approx((0.1, 0.05))
    assert (before.Cd_net, under.Cd_net) == pytest.approx((1.2, 0.85))
    assert (before.base_Cp, under.base_Cp) == pytest.approx((-0.7, -0.45))
    assert (before.mean_Cl, under.mean_Cl) == pytest.approx((-0.5, 0.2))
    assert (before.abs_Cl, under.abs_Cl) == pytest.approx((1.5, 0.3))
    assert (before.rms_action, under.rms_action) == pytest.approx((0.0, sqrt((0.03**2 + 0.04**2) / 2)))
    assert (before.jet_power, under.jet_power) == pytest.approx((0.0, 0.015))
    assert (before.Uy_std, under.Uy_std) == pytest.approx((0.5, 0.0))
    assert (before.duration, under.duration) == pytest.approx((0.4, 0.4))
    assert reduction_percent(before, under) == pytest.approx(100 * 0.25 / 1.1)


@pytest.mark.parametrize(("settle", "kept"), [(0.0, 4), (0.2, 3), (0.39, 2), (0.6, 1), (0.61, 0), (50.0, 0)])
def test_settling_ends_with_the_first_sample_at_or_after_it(log_of, settle, kept):
    under = regimes(log_of(), settle)[1]
    assert (0.0 if isnan(under.duration) else under.duration) == pytest.approx(0.2 * kept)


def test_latency_is_that_of_the_planned_steps(log_of):
    mode = [Mode.OFF, Mode.WARMUP, Mode.CONTROL, Mode.CONTROL, Mode.CONTROL, Mode.HOLD]
    # The middle one was skipped: it has no time, and the mode of the one before.
    timing = latency(log_of(mode=mode, step_ms=[50.0, 50.0, 2.0, NAN, 4.0, 50.0]))
    assert (timing.p50, timing.p99, timing.max, timing.steps) == pytest.approx((3.0, 3.98, 4.0, 2))
    none = latency(log_of())
    assert none.steps == 0
    assert isnan(none.max)
