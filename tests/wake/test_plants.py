"""Where a run's flow begins: the shipped start, or a state of the user's that fits the settings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import PlantError
from wake.plants import open_plant
from wake.truck.state import save_state
from wake.truck.truck_wake import TruckWake

SLOW = Config(flow=FlowConfig(reynolds=400.0))


@pytest.fixture(scope="module")
def start(tmp_path_factory) -> Path:
    """A flow at rest, of another Reynolds number, whose clock has run on."""
    path = tmp_path_factory.mktemp("start") / "re400.npz"
    save_state(path, replace(TruckWake(SLOW.flow).state(), substep=7, action=0.02))
    return path


def test_the_shipped_start_is_of_one_reynolds_number(tmp_path):
    with open_plant("stillwake", tmp_path, Config()) as wake:
        assert wake.t == 0.0
    with (
        pytest.raises(
            PlantError, match=r"flow\.reynolds = 400: the shipped start is of 500; `stillwake develop start_re400\.npz"
        ),
        open_plant("stillwake", tmp_path, SLOW),
    ):
        pass


def test_a_start_of_that_number_is_taken_at_time_zero(tmp_path, start):
    with open_plant("stillwake", tmp_path, SLOW, start=start) as wake:
        sample = wake.sample()
    assert (wake.t, sample.action) == (0.0, 0.0)
    assert np.isfinite(sample.Cp).all()


def test_a_start_of_another_number_is_refused_with_what_would_do(tmp_path, start):
    with (
        pytest.raises(
            PlantError, match=r"flow\.reynolds = 500: start .*re400\.npz is of 400; .*--set flow\.reynolds=500"
        ),
        open_plant("stillwake", tmp_path, Config(), start=start),
    ):
        pass


def test_openfoam_takes_no_state_file(tmp_path, start):
    with (
        pytest.raises(PlantError, match="OpenFOAM develops its own"),
        open_plant("openfoam", tmp_path, SLOW, start=start),
    ):
        pass
