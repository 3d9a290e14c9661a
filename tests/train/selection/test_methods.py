"""One door to all methods: what it refuses, and that each keeps to its budget."""

from dataclasses import replace

import pytest

from contract import sensors
from contract.config.learning import SelectionMethod
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.errors import ConfigError
from train.networks.model import Encoder, WakeModel
from train.samples.rows import Rows
from train.selection.methods import METHODS, select


@pytest.fixture
def encoder(small_config: Config) -> Encoder:
    return WakeModel(90, small_config.model).encoder


@pytest.mark.parametrize("method", METHODS)
def test_every_method_chooses_as_many_as_asked_and_the_same_again(
    method: SelectionMethod, encoder: Encoder, rows: Rows, small_config: Config
) -> None:
    settings = replace(small_config.train, shap_background=4, shap_explained=5, shap_samples=2)
    names = select(method, encoder, rows, 3, settings=settings)
    assert len(sensors.TRUCK.indices(names)) == 3  # refuses unknown and repeated names
    assert names == select(method, encoder, rows, 3, settings=settings)


def test_another_seed_draws_anew(encoder: Encoder, rows: Rows, small_config: Config) -> None:
    found = {
        select("random", encoder, rows, 5, settings=replace(small_config.train, seed=seed), draws=1)
        for seed in range(4)
    }
    assert len(found) == 4


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [0, 91])
def test_a_budget_that_cannot_be_met_is_refused(
    method: SelectionMethod, count: int, encoder: Encoder, rows: Rows, small_config: Config
) -> None:
    with pytest.raises(ConfigError, match=rf"train\.sensors = {count}: must be from 1 to 90"):
        select(method, encoder, rows, count, settings=small_config.train)


def test_an_unknown_method_is_refused_with_the_known_ones(encoder: Encoder, rows: Rows, small_config: Config) -> None:
    with pytest.raises(ConfigError, match=r"'entropy': use shap, qr, greedy, random, hand$"):
        select("entropy", encoder, rows, 4, settings=small_config.train)  # type: ignore[arg-type]
    with pytest.raises(
        ConfigError, match=r"train\.selection = 'entropy': must be 'shap', 'qr', 'greedy', 'random' or 'hand'"
    ):
        load_config(None, ['train.selection="entropy"'])


def test_no_draws_are_refused(encoder: Encoder, rows: Rows, small_config: Config) -> None:
    with pytest.raises(ConfigError, match="draws = 0: must be at least 1"):
        select("random", encoder, rows, 4, settings=small_config.train, draws=0)


def test_all_sensors_can_be_chosen(encoder: Encoder, rows: Rows, small_config: Config) -> None:
    for method in ("qr", "hand"):
        assert set(select(method, encoder, rows, 90, settings=small_config.train)) == set(sensors.NAMES)
