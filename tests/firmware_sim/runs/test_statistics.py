"""Figures of a run against numbers worked out by hand."""

from dataclasses import replace
from math import isnan, sqrt
from typing import Any

import numpy as np
import pytest

from can_bridge.wire.messages import Mode
from firmware_sim.runs.statistics import NoAverages, averages, latency, sample_to_jets_ms

NAN = float("nan")
CYCLE = 25
"""Periods."""


def averaged(log) -> Any:
    return averages(log)


def test_averages_are_over_whole_cycles_before_and_after_settling(shedding):
    """The lift crosses upwards at 0.8, 5.8 and 10.8 t_c; three such cycles fit into the 80 periods after settling."""
    # Sines of the cycle leave no trace in a mean over whole cycles, wherever they begin.
    wave = np.sin(2.0 * np.pi * np.arange(99) / CYCLE + 0.3)
    log = shedding(
        Cd=0.88 + 0.05 * wave, Cl=-0.02 + 0.3 * wave, action=0.05 * np.cos(2.0 * np.pi * np.arange(99) / CYCLE)
    )
    log.series["base_Cp"][:] = np.where(log.series["t"] <= 12.0, -0.5, -0.3)
    log.series["Cd_slot_pressure"][:], log.series["Cd_momentum"][:] = 0.3, -0.1
    log.series["jet_power"][61:] = 0.02
    found = averaged(log)
    before, under = found.before, found.under
    assert (before.cycles, under.cycles) == (2, 3)
    assert (before.frequency, under.frequency) == pytest.approx((0.2, 0.2), rel=1e-4)
    assert (before.duration, under.duration) == pytest.approx((10.0, 15.0), rel=1e-4)
    assert (before.Cd, under.Cd) == pytest.approx((1.1, 0.88), abs=1e-4)
    assert (before.Cd_net, under.Cd_net) == pytest.approx((1.3, 1.08), abs=1e-4)
    assert under.Cd_std == pytest.approx(0.05 / sqrt(2), rel=1e-2)
    assert (before.base_Cp, under.base_Cp) == pytest.approx((-0.5, -0.3))
    assert (before.mean_Cl, under.mean_Cl) == pytest.approx((0.0, -0.02), abs=2e-3)
    # The mean of |sin| is 2 / pi; straight lines between 25 samples a cycle cut the corners at zero a little.
    assert before.abs_Cl == pytest.approx(2 / np.pi, rel=1e-2)
    assert (before.rms_action, under.rms_action) == pytest.approx((0.0, 0.05 / sqrt(2)), rel=1e-2)
    assert (before.jet_power, under.jet_power) == pytest.approx((0.0, 0.02))
    assert found.reduction_percent == pytest.approx(20.0, abs=0.01)
    # What settles is left out, the sample at the request apart, which is in the lead-in as well.
    log.series["Cd"][61:80] = 99.0
    assert averaged(log).under.Cd == pytest.approx(0.88, abs=1e-4)


def test_plain_means_would_depend_on_the_cut(shedding):
    """The same wake with and without control: whole cycles show no change, whatever the settling time."""
    for settle in (0.0, 1.0, 2.6, 4.0, 8.2):
        log = shedding(settle=settle)
        phase = 2.0 * np.pi * 0.2 * log.series["t"] - 1.0
        log.series["Cl"][:], log.series["Cd"][:] = np.sin(phase), 1.1 + 0.1 * np.sin(phase + 0.5)
        assert averaged(log).reduction_percent == pytest.approx(0.0, abs=0.02)


def test_a_wake_that_does_not_shed_or_settles_to_its_end_has_no_averages(shedding):
    log = shedding()
    log.series["Cl"][:61] = 0.3
    still = averages(log)
    assert isinstance(still, NoAverages)
    assert "without control, the lift crosses zero upwards 0 times" in still.why
    for settle in (18.0, 20.0, 500.0):
        unsettled = averages(shedding(settle=settle))
        assert isinstance(unsettled, NoAverages)
        assert "under control, " in unsettled.why and "a whole cycle of 5.00 t_c" in unsettled.why
    assert averages(shedding(averages=False)) == NoAverages("No averages were requested.")


def test_latency_is_that_of_the_planned_steps(log_of):
    mode = [Mode.OFF, Mode.WARMUP, Mode.CONTROL, Mode.CONTROL, Mode.CONTROL, Mode.HOLD]
    # The middle one was skipped: it has no time, and the mode of the one before.
    timing = latency(log_of(mode=mode, step_ms=[50.0, 50.0, 2.0, NAN, 24.0, 50.0]))
    assert (timing.p50, timing.p90, timing.p99, timing.max) == pytest.approx((13.0, 21.8, 23.78, 24.0))
    assert (timing.steps, timing.over_budget) == (2, 1)
    none = latency(log_of())
    assert (none.steps, none.over_budget) == (0, 0)
    assert isnan(none.max)


def test_the_actuators_delay_is_part_of_the_way_to_the_jets(shedding):
    log = shedding()
    config = replace(log.metadata.config, vehicle=replace(log.metadata.config.vehicle, actuator_delay=4))
    late = replace(log, metadata=replace(log.metadata, config=config))
    # Four periods of 20 ms.
    assert (sample_to_jets_ms(log), sample_to_jets_ms(late)) == pytest.approx((8.3, 88.3))
    late.series["age_ms"][:] = NAN
    assert isnan(sample_to_jets_ms(late))
