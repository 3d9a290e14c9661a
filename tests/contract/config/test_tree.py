import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import pytest

from contract.config.controller import CostWeights, MpcConfig
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.config.vehicle import BusConfig, E2eConfig, EcuConfig
from contract.errors import ConfigError


def groups(tree: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Every section with its dotted name."""
    for field in fields(tree):
        value = getattr(tree, field.name)
        if is_dataclass(value):
            yield f"{above}{field.name}", value
            yield from groups(value, f"{above}{field.name}.")


def test_every_number_must_be_finite_and_none_but_a_reference_may_be_negative():
    for _, group in groups(Config()):
        for field in fields(group):
            value = getattr(group, field.name)
            if isinstance(value, str | bool) or is_dataclass(value):
                continue
            bad = [math.nan, math.inf, -math.inf]
            if field.name != "drag_reference":
                bad.append(-1 if isinstance(value, int) else -1e-9)
            for wrong in bad:
                with pytest.raises(ConfigError, match=rf"{group.section}\.{field.name} = {wrong}: must be"):
                    type(group)(**{field.name: wrong})


def test_value_out_of_range_is_refused_by_name():
    refused: list[tuple[type[Any], str, object, str]] = [
        (OperatingPoint, "speed", 0.0, "positive"),
        (MpcConfig, "horizon", 1, "at least 2"),
        (FlowConfig, "action_limit", 0.0, "positive"),
        (EcuConfig, "rearm_frames", 0, "at least 1"),
        (EcuConfig, "loss_limit", 0, r"in 1\.\.loss_window"),
        (EcuConfig, "loss_limit", 51, r"in 1\.\.loss_window"),
        (BusConfig, "channel", "", "the name of a channel"),
        (BusConfig, "nominal_bitrate", 1_000_001, "at most 1000000"),
        (BusConfig, "data_bitrate", 499_999, r"in nominal_bitrate\.\.8000000"),
        (BusConfig, "data_bitrate", 8_000_001, r"in nominal_bitrate\.\.8000000"),
        (E2eConfig, "min_ok", 6, r"in 1\.\.window"),
        (E2eConfig, "max_errors", 5, r"in 0\.\.window-1"),
        (E2eConfig, "max_delta", 128, r"in 1\.\.127"),
        (E2eConfig, "window", 0, "at least 1"),
    ]
    for kind, name, value, must in refused:
        with pytest.raises(ConfigError, match=rf"\.{name} = {value!r}: must be {must}"):
            kind(**{name: value})
    assert BusConfig(frames="classic", data_bitrate=1).data_bitrate == 1, "classic frames have no data bit rate"


def test_defaults_are_the_papers():
    config = Config()
    assert (config.model.window, config.model.latent, config.mpc.horizon, config.mpc.iterations) == (32, 8, 25, 5)
    assert config.flow.action_limit == 0.075
    assert config.period_ns == 20_000_000


def test_weights_keep_declaration_order():
    weights = CostWeights(**{field.name: float(i) for i, field in enumerate(fields(CostWeights))})
    assert weights.as_tuple() == tuple(map(float, range(len(fields(CostWeights)))))


def test_a_section_is_called_by_its_place_in_the_tree():
    for name, group in groups(Config()):
        assert group.section == name
