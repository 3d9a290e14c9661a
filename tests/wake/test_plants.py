"""Where a run's flow begins: the shipped start, or a state of the user's that fits. A recording as a plant."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import PlantError
from contract.recording.episode import Episode
from contract.sensor_layout import SensorLayout
from wake.plants import open_plant
from wake.recorded_wake import RecordedWake
from wake.solver.grid import truck_grid
from wake.truck.state import developed_state, save_state
from wake.truck.truck_wake import TruckWake

COARSE = Config(flow=FlowConfig(refinement=0.4, substeps=12))
SLOW = Config(flow=replace(COARSE.flow, reynolds=400.0))


@pytest.fixture(scope="module")
def starts(tmp_path_factory):
    """The shipped state, and a flow at rest of another Reynolds number whose clock has run on."""
    folder = tmp_path_factory.mktemp("starts")
    save_state(folder / "re400.npz", replace(TruckWake(SLOW.flow).state(), substep=7, action=0.02))
    save_state(folder / "fine.npz", replace(developed_state(), substep=0))
    return folder


def test_a_run_begins_at_time_zero_in_the_shipped_wake_or_in_a_start_of_its_number(tmp_path, starts):
    with open_plant("wake", tmp_path, Config()) as wake:
        assert wake.t == 0.0
    with open_plant("wake", tmp_path, SLOW, start=starts / "re400.npz") as wake:
        sample = wake.sample()
    assert (wake.t, sample.action) == (0.0, 0.0)
    assert np.isfinite(sample.Cp).all()


def test_the_shipped_wake_settles_on_any_grid(tmp_path, monkeypatch):
    monkeypatch.setattr("wake.plants.SETTLE_TIME", 0.2)
    told: list[float] = []
    with open_plant("wake", tmp_path, COARSE, progress=lambda t, _: told.append(t)) as wake:
        assert wake.t == 0.0
        assert wake.grid.shape == truck_grid(0.4).shape
    assert told == [pytest.approx(0.2)]


def test_what_does_not_fit_is_refused_with_what_would_do(tmp_path, starts):
    square = Config(body=BodyConfig(length=1.0, leading_edge_radius=0.0))
    cases: list[tuple[Any, Config, str | None, str]] = [
        ("wake", SLOW, None, r"flow\.reynolds = 400: the shipped start has 500; `stillwake develop start_re400"),
        ("wake", Config(), "re400.npz", r"reynolds = 500: state .*re400\.npz has 400; .*--set"),
        ("wake", COARSE, "fine.npz", r"443 x 164 cells, this grid needs 177 x 66: .*flow\.refinement"),
        ("openfoam", SLOW, "re400.npz", "OpenFOAM develops its own"),
        ("openfoam", square, None, r"body\.length = 1\.0: must be 7\.647, because OpenFOAM's mesh"),
    ]
    for plant, config, start, message in cases:
        path = None if start is None else starts / start
        with pytest.raises(PlantError, match=message), open_plant(plant, tmp_path, config, start=path):
            pass
    assert not any(tmp_path.iterdir())


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
    wake.advance_to(15, 0.07)
    assert wake.sample().action == pytest.approx(0.05)
    with pytest.raises(PlantError, match="from substep 15"):
        wake.advance_to(15)
    with pytest.raises(PlantError, match=r"a row every 0\.1 t_c"):
        RecordedWake(recording(period=0.1), LAYOUT, FLOW)
