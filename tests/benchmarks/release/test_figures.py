"""The release's figures where they are known: forecasts, net of jet power, the campaign's tables."""

import numpy as np
import pytest

from benchmarks.release.release_figures import forecast_errors
from benchmarks.release.release_loop import FIGURES, spread, with_net
from benchmarks.release.tables import campaign
from tests.firmware_sim.campaign.conftest import phase_of, rows_of, scenario_of

RUN = dict.fromkeys(FIGURES, 1.0)
RUN |= {"Cd_net_uncontrolled": 1.25, "Cd_net_controlled": 0.75, "jet_power_controlled": 0.25}


def test_an_error_belongs_to_the_instant_that_was_forecast():
    # The truth rises by 1 a period, and what is forecast for k + h lags by 0.1 h (drag) and 0.2 h (lift).
    periods, horizon = 30, 4
    k, h = np.arange(periods)[:, None], np.arange(1, horizon + 1)[None]
    truth = np.column_stack([np.arange(periods), 10.0 - np.arange(periods)])
    forecasts = np.stack([k + h - 0.1 * h, 10.0 - (k + h) + 0.2 * h], axis=-1)
    forecasts[7] = np.nan
    for ahead, errors in enumerate(forecast_errors(forecasts, truth), start=1):
        # The truth of the last forecasts is missing, and one period has none.
        assert errors.shape == (periods - ahead - 1, 2)
        np.testing.assert_allclose(errors, np.full_like(errors, 0.1) * [ahead, 2 * ahead])


def test_the_reduction_pays_for_the_jets_and_has_a_spread():
    figures = with_net(RUN)
    assert figures["net_reduction_percent"] == pytest.approx(40.0)
    # 0.5 less force, of which 0.25 goes into the jets.
    assert figures["net_of_power_percent"] == pytest.approx(20.0)
    over_phases = spread([{**RUN, "abs_Cl_controlled": value} for value in (0.1, 0.4, 0.1)])
    # Deviation 0.1 sqrt(3) of three values; tables give 4.3027 for the 97.5 % point of t with 2 degrees of freedom.
    wanted = {"mean": 0.2, "least": 0.1, "most": 0.4, "half_width_95": 0.43027}
    assert over_phases["abs_Cl_controlled"] == pytest.approx(wanted, rel=1e-4)


def test_every_scenario_of_a_campaign_has_a_row():
    rows = rows_of(
        (scenario_of("delay_12"), [phase_of(0.82), phase_of(0.80)]),
        (scenario_of("lost"), [phase_of(failure="it diverged")]),
    )
    facts = {"bundle_name": "small", "phases": 2, "controlled": 60.0, "settle": 20.0}
    made = campaign({"date": "2026-01-02", "figures": [row.figures() for row in rows], "facts": facts})
    assert "| delay_12 | useful | 19.0 (18.0..20.0) | 0.20 |  |" in made
    assert "| lost | **UNSAFE**, none | - | - | - |" in made
