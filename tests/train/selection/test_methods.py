"""One door to all methods: what it refuses, and that each keeps to its budget."""

from dataclasses import replace

import pytest

from contract import sensors
from contract.errors import ConfigError
from train.networks.model import Encoder, WakeModel
from train.selection.methods import METHODS, select


@pytest.fixture
def encoder(small_config) -> Encoder:
    return WakeModel(90, small_config.model).encoder


@pytest.mark.slow  # two rankings by SHAP
def test_every_method_chooses_as_many_as_asked_and_the_same_again(encoder, rows, small_config):
    settings = replace(small_config.train, shap_background=4, shap_explained=5, shap_samples=2)
    for method in METHODS:
        names = select(method, encoder, rows, 3, settings=settings)
        assert len(sensors.TRUCK.indices(names)) == 3, method  # refuses unknown and repeated names
        assert names == select(method, encoder, rows, 3, settings=settings), method
        for count in (0, 91):
            with pytest.raises(ConfigError, match=rf"train\.sensors = {count}: must be from 1 to 90"):
                select(method, encoder, rows, count, settings=settings)
    with pytest.raises(ConfigError, match=r"'entropy': use shap, qr, greedy, random, hand$"):
        select("entropy", encoder, rows, 4, settings=small_config.train)  # type: ignore[arg-type]
