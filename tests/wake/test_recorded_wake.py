"""A recording as a plant: its rows, in order, again and again."""

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.errors import PlantError
from contract.recording.episode import Episode
from contract.sensor_layout import SensorLayout
from wake.recorded_wake import RecordedWake

LAYOUT = SensorLayout.of(["a", "b"], np.array([[0.0, 0.5], [0.0, -0.5]]))
FLOW = FlowConfig()


def recording(rows: int = 3, period: float = 0.2) -> Episode:
    series = {
        "t": 7.0 + period * np.arange(rows),
        "action": np.full(rows, 0.05),
        "Cp": np.arange(2.0 * rows).reshape(rows, 2),
        "Cd": 1.0 + np.arange(rows),
        "Cl": -np.arange(float(rows)),
    }
    return Episode(name="calm", role="test", series=series, initial_action=0.0, provenance={})


def test_its_rows_come_again_whatever_the_jets_do():
    wake = RecordedWake(recording(), LAYOUT, FLOW)
    seen = []
    for _ in range(4):
        seen.append(wake.sample())
        wake.advance_to(10)
        wake.advance_to(FLOW.substeps, 0.03)
    assert [item.Cd for item in seen] == [1.0, 2.0, 3.0, 1.0]
    np.testing.assert_array_equal(seen[1].Cp, [2.0, 3.0])
    assert [item.t for item in seen] == pytest.approx([0.0, 0.2, 0.4, 0.6])
    assert [item.action for item in seen] == [0.0, 0.03, 0.03, 0.03]
    # Not recorded.
    assert np.isnan(seen[0].jet_power)
    assert (wake.rounds, wake.answers_jets) == (1, False)


def test_the_jets_reach_the_action_at_the_periods_end():
    wake = RecordedWake(recording(), LAYOUT, FLOW)
    wake.advance_to(15, 0.06)
    assert wake.sample().action == pytest.approx(0.03)
    with pytest.raises(PlantError, match="from substep 15"):
        wake.advance_to(15)
    # Another period is refused.
    with pytest.raises(PlantError, match=r"a row every 0\.1 t_c"):
        RecordedWake(recording(period=0.1), LAYOUT, FLOW)
