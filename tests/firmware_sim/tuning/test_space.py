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


def test_every_weight_but_the_unit_can_be_tuned_and_comes_back_from_the_settings() -> None:
    weights = {f"{WEIGHTS}{item.name}" for item in fields(CostWeights)}
    assert weights - set(RANGES) == {f"{WEIGHTS}drag_mean"}
    assert set(RANGES) - weights == {LEARNING_RATE, HORIZON}
    values = {LIFT: 0.25, LEARNING_RATE: 2e-3, HORIZON: 31.0}
    made = with_values(MpcConfig(), values)
    assert (made.weights.lift, made.learning_rate, made.horizon) == (0.25, 2e-3, 31)
    assert isinstance(made.horizon, int)
    assert values_of(made, tuple(values)) == changed(MpcConfig(), made) == values


def test_a_range_takes_in_the_present_value() -> None:
    present = MpcConfig(horizon=60, weights=CostWeights(lift=0.0, smoothness=100.0))
    ranges = ranges_around(present, tuple(RANGES))
    assert (ranges[HORIZON].low, ranges[HORIZON].high) == (20, 60)
    # No logarithm of zero.
    assert (ranges[LIFT].low, ranges[LIFT].log) == (0.0, False)
    assert (ranges[f"{WEIGHTS}smoothness"].high, ranges[f"{WEIGHTS}smoothness"].log) == (100.0, True)


def test_settings_are_named_whole_or_by_their_last_word_and_other_names_are_refused() -> None:
    assert chosen([], weights_only=False) == tuple(RANGES)
    assert chosen(["horizon", LIFT], weights_only=False) == (LIFT, HORIZON)
    assert set(chosen([], weights_only=True)) == set(RANGES) - {LEARNING_RATE, HORIZON}
    for names, weights_only, message in [
        (["drag_mean"], False, "--vary drag_mean: cannot be tuned; one of drag_fluctuation, lift,"),
        (["horizon"], True, "--vary horizon: fixed in the bundle's graph; name the bundle's model with --model"),
        (["lift", LIFT], False, f"--vary {LIFT}: given twice"),
    ]:
        with pytest.raises(ConfigError) as error:
            chosen(names, weights_only=weights_only)
        assert str(error.value).startswith(message), names


def test_settings_to_be_tried_come_from_text_and_other_text_is_refused() -> None:
    values = parsed("lift=0.2,mpc.horizon=30", MpcConfig(), (LIFT, LEARNING_RATE, HORIZON))
    assert values == {LIFT: 0.2, LEARNING_RATE: 1e-3, HORIZON: 30}
    for text, message in [
        ("effort=1", "'effort' is not varied; of lift, horizon"),
        ("lift=much", "'much' is no number"),
        ("lift", "'' is no number"),
        ("lift=nan", "lift must be from 0.01 to 0.3"),
        ("lift=0", "lift must be from 0.01 to 0.3"),
        ("lift=0.2,horizon=30.5", "horizon must be a whole number from 20 to 40"),
        ("", "'' is not varied; of lift, horizon"),
    ]:
        with pytest.raises(ConfigError) as error:
            parsed(text, MpcConfig(), (LIFT, HORIZON))
        assert str(error.value) == f"--try {text}: {message}"
