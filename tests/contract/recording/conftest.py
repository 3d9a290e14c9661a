"""A data set of two episodes of the truck."""

from pathlib import Path

import pytest

from contract.recording import dataset
from contract.recording.dataset import Dataset
from tests.contract.recording.random_episodes import episode


@pytest.fixture
def written(tmp_path) -> Path:
    path = tmp_path / "data.h5"
    dataset.write(path, Dataset(episodes=(episode("b"), episode("a", steps=7, role="test"))))
    return path
