"""Which settings are tuned, and between which values."""

from dataclasses import fields

import pytest

from contract.config.controller import CostWeights, MpcConfig
from contract.errors import ConfigError
from firmware_sim.tuning.space import (
    HORIZON,
    LEARNING_RATE,
    RANGES,
    WEIGHTS,
    changed,
    chosen,
    parsed,
    ranges_around,
    values_of,
    with_values,
)

LIFT = f"{WEIGHTS}lift"


def test_every_weight_but_the_unit_can_be_tuned() -> None:
    weights = {f"{WEIGHTS}{item.name}" for item in fields(CostWeights)}
    assert weights - set(RANGES) == {f"{WEIGHTS}drag_mean"}
    assert set(RANGES) - weights == {LEARNING_RATE, HORIZON}


def test_values_come_back_from_the_settings_they_were_put_into() -> None:
    values = {LIFT: 0.25, LEARNING_RATE: 2e-3, HORIZON: 31.0}
    made = with_values(MpcConfig(), values)
    assert (made.weights.lift, made.learning_rate, made.horizon) == (0.25, 2e-3, 31)
    assert isinstance(made.horizon, int)
    assert values_of(made, tuple(values)) == values
    assert changed(MpcConfig(), made) == values
    assert made.weights.smoothness == MpcConfig().weights.smoothness


def test_a_range_takes_in_the_present_value() -> None:
    present = MpcConfig(horizon=60, weights=CostWeights(lift=0.0, smoothness=100.0))
    found = ranges_around(present, tuple(RANGES))
    assert (found[HORIZON].low, found[HORIZON].high) == (20, 60)
    # No logarithm of zero.
    assert (found[LIFT].low, found[LIFT].log) == (0.0, False)
    assert (found[f"{WEIGHTS}smoothness"].high, found[f"{WEIGHTS}smoothness"].log) == (100.0, True)


def test_settings_are_named_whole_or_by_their_last_word() -> None:
    assert chosen([], weights_only=False) == tuple(RANGES)
    assert chosen(["horizon", LIFT], weights_only=False) == (LIFT, HORIZON)
    assert set(chosen([], weights_only=True)) == set(RANGES) - {LEARNING_RATE, HORIZON}


def test_other_names_are_refused() -> None:
    for names, weights_only, says in [
        (["drag_mean"], False, "--vary drag_mean: cannot be tuned; one of drag_fluctuation, lift,"),
        (["horizon"], True, "--vary horizon: fixed in the bundle's graph; name the bundle's model with --model"),
        (["lift", LIFT], False, f"--vary {LIFT}: given twice"),
    ]:
        with pytest.raises(ConfigError) as error:
            chosen(names, weights_only=weights_only)
        assert str(error.value).startswith(says), names


def test_settings_to_be_tried_come_from_text() -> None:
    present = MpcConfig()
    found = parsed("lift=0.2,mpc.horizon=30", present, (LIFT, LEARNING_RATE, HORIZON))
    assert found == {LIFT: 0.2, LEARNING_RATE: 1e-3, HORIZON: 30}


def test_text_that_names_no_settings_is_refused() -> None:
    for text, says in [
        ("effort=1", "--try effort=1: 'effort' is not varied; of lift, horizon"),
        ("lift=much", "--try lift=much: 'much' is no number"),
        ("lift", "--try lift: '' is no number"),
        ("lift=nan", "--try lift=nan: lift must be from 0.01 to 0.3"),
        ("lift=0", "--try lift=0: lift must be from 0.01 to 0.3"),
        ("lift=0.2,horizon=30.5", "--try lift=0.2,horizon=30.5: horizon must be a whole number from 20 to 40"),
        ("", "--try : '' is not varied; of lift, horizon"),
    ]:
        with pytest.raises(ConfigError) as error:
            parsed(text, MpcConfig(), (LIFT, HORIZON))
        assert str(error.value) == says, text
