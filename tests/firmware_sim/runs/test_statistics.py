"""Figures of a run and of a drive against numbers worked out by hand."""

from dataclasses import replace
from math import isnan, sqrt

import numpy as np
import pytest

from can_bridge.wire.messages import Mode
from contract.config.operating_point import OperatingPoint
from firmware_sim.runs.run_log import load, save
from firmware_sim.runs.statistics import NoAverages, averages, drive_totals, latency, sample_to_jets_ms
from firmware_sim.runs.summary import drag_rows, headline, summary
from tests.firmware_sim.runs.conftest import LEAD_IN, STEP, averaged, shedding_log

NAN = float("nan")
CYCLE = 25  # periods
POINT = OperatingPoint()


def test_averages_are_over_whole_cycles_before_and_after_settling(shedding):
    """The lift crosses upwards at 0.8, 5.8 and 10.8 t_c; three such cycles fit into the 80 periods after settling."""
    # Sines of the cycle leave no trace in a mean over whole cycles, wherever they begin.
    wave = np.sin(2.0 * np.pi * np.arange(99) / CYCLE + 0.3)
    action = 0.05 * np.cos(2.0 * np.pi * np.arange(99) / CYCLE)
    log = shedding(Cd=0.88 + 0.05 * wave, Cl=-0.02 + 0.3 * wave, action=action)
    log.series["base_Cp"][:] = np.where(log.series["t"] <= 12.0, -0.5, -0.3)
    log.series["Cd_slot_pressure"][:], log.series["Cd_momentum"][:] = 0.3, -0.1
    log.series["jet_power"][61:] = 0.02
    found = averaged(log)
    before, under = found.before, found.under
    assert (before.cycles, under.cycles) == (2, 3)
    assert (before.frequency, under.frequency) == pytest.approx((0.2, 0.2), rel=1e-4)
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


@pytest.fixture
def log(run_metadata):
    """From 20 m/s to 30 m/s in the ten seconds that count, Cd as the speed's square; 0.8 of that under control."""
    log = shedding_log(run_metadata, drive="mine", settle=0.0)
    series, count = dict(log.series), len(log.series["t"])
    speed = 20.0 + 10.0 * np.clip((np.arange(count) - LEAD_IN) / (count - LEAD_IN - 1), 0.0, 1.0)
    square = (speed / POINT.speed) ** 2
    series |= {"speed": speed, "Cd": 0.8 * square, "Cd_momentum": -0.1 * square, "jet_power": np.full(count, 0.05)}
    series |= {"without_Cd": square, "without_Cd_net": 1.1 * square, "without_Cl": -0.5 * square, "Cl": 0.2 * square}
    object.__setattr__(log, "series", series)
    return log


def test_energies_are_integrals_of_force_times_speed(log):
    found = drive_totals(log)
    assert found is not None
    seconds = (len(log.series["t"]) - LEAD_IN - 1) * STEP * POINT.convective_time
    # Speed rises evenly: v^3 has the mean (30^4 - 20^4) / (4 * 10), and N/m is kJ a km and a metre.
    cubes = (30.0**4 - 20.0**4) / 40.0
    force = 0.5 * POINT.density * POINT.width * cubes / 25.0
    # The trapezoidal rule on 99 intervals is 1 / 12 n^2 off at most.
    assert found.distance_m == pytest.approx(25.0 * seconds)
    assert found.mean_speed_m_per_s == pytest.approx(25.0)
    assert found.drag_kJ_per_km_without == pytest.approx(force, rel=1e-4)
    assert found.drag_kJ_per_km == pytest.approx(0.8 * force, rel=1e-4)
    assert found.reduction_percent == pytest.approx(20.0)
    jets = 0.05 * 0.5 * POINT.density * POINT.speed**3 * POINT.width / 25.0
    assert found.jets_kJ_per_km == pytest.approx(jets)
    assert found.net_kJ_per_km == pytest.approx(0.7 * force + jets, rel=1e-4)
    assert found.net_reduction_percent == pytest.approx(100.0 * (1.0 - (0.7 * force + jets) / (1.1 * force)), rel=1e-3)
    assert [found.abs_Cl, found.abs_Cl_without] == pytest.approx([0.2, 0.5])
    assert found.in_control_percent == 100.0


def test_they_are_in_summary_table_headline_and_file(log, tmp_path):
    assert summary(log)["drive"]["reduction_percent"] == pytest.approx(20.0)
    assert summary(log)["reduction_percent"] is None
    assert drag_rows(log)[0][0] == "drive mine"
    assert "Drive mine: 20.0 % less energy against wall drag" in headline(log)
    save(tmp_path / "series.npz", log)
    assert drive_totals(load(tmp_path / "series.npz")) == drive_totals(log)


def test_another_run_has_none_and_a_standstill_no_energy_a_km(log, shedding):
    assert drive_totals(shedding()) is None
    log.series["speed"][:] = 0.0
    found = summary(log)["drive"]
    assert (found["distance_m"], found["drag_kJ_per_km"], found["abs_Cl"]) == (0.0, None, None)
    assert "the vehicle did not move" in headline(log)
