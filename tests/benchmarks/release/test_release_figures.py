"""Errors of forecasts and distributions, where both are known."""

import numpy as np
import pytest

from benchmarks.release.release_figures import CASES, forecast_errors, measured
from firmware_sim.runs.bus_traffic import BusTraffic
from firmware_sim.runs.metadata import RunMetadata
from firmware_sim.runs.run_log import BusTotals, RunLog


def test_an_error_belongs_to_the_instant_that_was_forecast() -> None:
    # The truth rises by 1 a period, and what is forecast for k + h lags by 0.1 h (drag) and 0.2 h (lift).
    periods, horizon = 30, 4
    k, h = np.arange(periods)[:, None], np.arange(1, horizon + 1)[None]
    truth = np.column_stack([np.arange(periods), 10.0 - np.arange(periods)])
    forecasts = np.stack([k + h - 0.1 * h, 10.0 - (k + h) + 0.2 * h], axis=-1)
    forecasts[7] = np.nan
    for ahead, found in enumerate(forecast_errors(forecasts, truth), start=1):
        # Of the last ones the truth never came, and of one period there is none.
        assert found.shape == (periods - ahead - 1, 2)
        np.testing.assert_allclose(found, np.full_like(found, 0.1) * [ahead, 2 * ahead])


def test_distributions_are_of_the_two_cases_alone(run_metadata: RunMetadata) -> None:
    settled, generator = 80, np.random.default_rng(4)
    base = np.concatenate([generator.normal(-0.5, 0.02, 60), np.full(20, 9.0), generator.normal(-0.2, 0.01, 80)])
    series = {"Cd": np.full(160, 0.8), "Cl": np.zeros(160), "base_Cp": base, "Uy_probe": base}
    quiet = BusTraffic(load=0.0, frames=0, error_frames=0, longest_wait_ms={}, nodes={})
    bus = BusTotals(sent=0, lost=0, rejected=0)
    log = RunLog(series=series, enabled_at=60, bus=bus, traffic=quiet, metadata=run_metadata)
    found = measured(log, np.zeros((160, 3, 2)), settled)
    assert [row["h"] for row in found["forecast"]] == [1, 2, 3]
    # Forecast is 0, and came 0.8.
    assert found["forecast"][2]["drag"] == pytest.approx({"mean": 0.8, "p10": 0.8, "p90": 0.8})
    for case, part in zip(CASES, (base[:60], base[80:]), strict=True):
        one, edges = found["base_Cp"][case], np.array(found["base_Cp"]["edges"])
        assert (one["mean"], one["std"], one["samples"]) == (
            pytest.approx(part.mean()),
            pytest.approx(part.std()),
            len(part),
        )
        assert np.sum(np.diff(edges) * one["density"]) == pytest.approx(1.0)
    # What came between the two cases is of neither.
    assert found["base_Cp"]["edges"][-1] < 0.0
