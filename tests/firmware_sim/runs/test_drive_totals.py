"""A drive's totals, against integrals by hand."""

import numpy as np
import pytest

from contract.config.operating_point import OperatingPoint
from firmware_sim.runs.drive_totals import drive_totals
from firmware_sim.runs.run_log import load, save
from firmware_sim.runs.run_tables import drag_rows, headline
from firmware_sim.runs.summary import summary
from tests.firmware_sim.runs.conftest import LEAD_IN, STEP, shedding_log

POINT = OperatingPoint()


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
