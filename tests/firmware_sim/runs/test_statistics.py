"""Figures of a run against numbers worked out by hand."""

from math import isnan, sqrt

import numpy as np
import pytest

from can_bridge.wire.messages import Mode
from contract.errors import StillwakeError
from firmware_sim.runs import run_log
from firmware_sim.runs.report import drag_rows, headline, service_rows
from firmware_sim.runs.run_log import COLUMNS, BusTotals, RunLog
from firmware_sim.runs.statistics import latency, reduction_percent, regimes

NAN = float("nan")


def log_of(enabled_at: int = 2, settle: float = 0.4, **columns) -> RunLog:
    """A run of six periods of 0.2 t_c; columns not given are zero."""
    series = {name: np.zeros(6) for name in COLUMNS}
    series["t"] = 100.0 + 0.2 * np.arange(6)
    series |= {name: np.array(values, dtype=float) for name, values in columns.items()}
    facts = {"settle": settle, "budget_ms": 20.0}
    return RunLog(series=series, enabled_at=enabled_at, bus=BusTotals(sent=12, lost=1, rejected=2), facts=facts)


def test_averages_before_and_after_settling():
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
def test_settling_ends_with_the_first_sample_at_or_after_it(settle, kept):
    under = regimes(log_of(), settle)[1]
    assert (0.0 if isnan(under.duration) else under.duration) == pytest.approx(0.2 * kept)


def test_latency_is_that_of_the_planned_steps():
    mode = [Mode.OFF, Mode.WARMUP, Mode.CONTROL, Mode.CONTROL, Mode.CONTROL, Mode.HOLD]
    # The middle one was skipped: it has no time, and the mode of the one before.
    timing = latency(log_of(mode=mode, step_ms=[50.0, 50.0, 2.0, NAN, 4.0, 50.0]))
    assert (timing.p50, timing.p99, timing.max, timing.steps) == pytest.approx((3.0, 3.98, 4.0, 2))
    none = latency(log_of())
    assert none.steps == 0
    assert isnan(none.max)


def test_tables_show_the_figures():
    log = log_of(
        Cd=[1.0, 1.2, 9.0, 9.0, 0.8, 0.9],
        Cl=[-1.0, 1.0, 9.0, 9.0, 0.1, -0.1],
        mode=[Mode.CONTROL] * 6,
        step_ms=[2.0] * 6,
        age_ms=[NAN, 8.3, 8.4, 8.3, NAN, NAN],
    )
    assert ("mean Cd (wall)", "1.1000", "0.8500") in drag_rows(log)
    service = dict(service_rows(log))
    assert service["frames sent"] == "12"
    assert service["frames lost"] == "1"
    assert service["frames rejected"] == "2"
    assert service["sample to jets in virtual time, max"] == "8.40 ms"
    assert service["periods in control / in all"] == "6 / 6"


@pytest.mark.parametrize(
    ("cd", "cl", "said"),
    [
        (0.88, 0.1, ["22.7 % less", "side force down"]),
        (0.88, 2.0, ["22.7 % less", "but the wake is deflected"]),
        (1.32, 0.1, ["20.0 % more"]),
    ],
)
def test_the_headline_says_whether_a_reduction_counts(cd, cl, said):
    before = 1.1 if cd > 1.0 else 1.138
    log = log_of(Cd=[before, before, 9.0, 9.0, cd, cd], Cl=[-1.0, 1.0, 9.0, 9.0, cl, cl])
    for words in said:
        assert words in headline(log)


def test_a_run_without_controlled_time_has_no_headline():
    assert "too short" in headline(log_of(settle=50.0, Cd=[1.0] * 6))


def test_a_saved_run_is_read_back_to_the_bit(tmp_path):
    log = log_of(Cd=[1.0, NAN, 1 / 3, 0.0, -0.0, 1e-300])
    run_log.save(tmp_path / "a" / "series.npz", log)
    found = run_log.load(tmp_path / "a" / "series.npz")
    assert (found.bus, found.enabled_at, found.facts) == (log.bus, log.enabled_at, log.facts)
    for name, values in log.series.items():
        np.testing.assert_array_equal(found.series[name], values)


def test_a_file_that_is_no_run_is_refused_by_name(tmp_path):
    path = tmp_path / "series.npz"
    with pytest.raises(StillwakeError, match=r"series\.npz: not the series of a run"):
        run_log.load(path)
    for content in (b"", b"PK\x03\x04 nonsense", b"\x93NUMPY"):
        path.write_bytes(content)
        with pytest.raises(StillwakeError, match="not the series of a run"):
            run_log.load(path)
    np.savez(path, header="{}", t=np.zeros(3))
    with pytest.raises(StillwakeError, match="not the series of a run"):
        run_log.load(path)
