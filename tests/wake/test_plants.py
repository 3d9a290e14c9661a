"""Where a run's flow begins: the shipped start, or a state of the user's that fits the settings."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import PlantError
from wake.plants import open_plant
from wake.solver.grid import truck_grid
from wake.truck.state import developed_state, save_state
from wake.truck.truck_wake import TruckWake

SLOW = Config(flow=FlowConfig(reynolds=400.0))
COARSE = Config(flow=FlowConfig(refinement=0.4, substeps=12))


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
        ("wake", SLOW, None, r"flow\.reynolds = 400: the shipped start is of 500; `stillwake develop start_re400"),
        ("wake", Config(), "re400.npz", r"reynolds = 500: state .*re400\.npz is of 400; .*--set"),
        ("wake", COARSE, "fine.npz", r"443 x 164 cells, this grid needs 177 x 66: .*flow\.refinement"),
        ("openfoam", SLOW, "re400.npz", "OpenFOAM develops its own"),
        ("openfoam", square, None, r"body\.length = 1\.0: OpenFOAM's mesh is the truck's, with 7\.647"),
    ]
    for plant, config, start, message in cases:
        path = None if start is None else starts / start
        with pytest.raises(PlantError, match=message), open_plant(plant, tmp_path, config, start=path):
            pass
    assert not any(tmp_path.iterdir())
