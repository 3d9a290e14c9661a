import math
from dataclasses import fields, is_dataclass
from typing import Any

import pytest

from contract.config.controller import CostWeights, MpcConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.config.vehicle import BusConfig, E2eConfig, EcuConfig
from contract.errors import ConfigError


def leaves(tree: Any, above: tuple[str, ...] = ()):
    for field in fields(tree):
        value = getattr(tree, field.name)
        if is_dataclass(value):
            yield from leaves(value, (*above, field.name))
        else:
            yield type(tree), field.name, value


NUMBERS = [
    pytest.param(owner, name, value, id=f"{owner.__name__}.{name}")
    for owner, name, value in leaves(Config())
    if not isinstance(value, str | bool)
]


@pytest.mark.parametrize(("owner", "name", "value"), NUMBERS)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_every_number_must_be_finite(owner, name, value, bad):
    with pytest.raises(ConfigError, match=name):
        owner(**{name: bad})


# A reference may have either sign.
@pytest.mark.parametrize(
    ("owner", "name", "value"), [item for item in NUMBERS if item.id != "MpcConfig.drag_reference"]
)
def test_no_number_may_be_negative(owner, name, value):
    with pytest.raises(ConfigError, match=name):
        owner(**{name: -1 if isinstance(value, int) else -1e-9})


@pytest.mark.parametrize(
    ("build", "culprit"),
    [
        (lambda: MpcConfig(horizon=1), "horizon = 1"),
        (lambda: FlowConfig(action_limit=0.0), "action_limit"),
        (lambda: EcuConfig(rearm_frames=0), "rearm_frames"),
        (lambda: EcuConfig(loss_limit=0), "loss_limit"),
        (lambda: EcuConfig(loss_limit=51), "loss_limit"),
        (lambda: BusConfig(channel=""), "channel"),
        (lambda: BusConfig(nominal_bitrate=1_000_001), "nominal_bitrate = 1000001: must be at most 1000000"),
        (lambda: BusConfig(data_bitrate=499_999), r"data_bitrate = 499999: must be in nominal_bitrate\.\.8000000"),
        (lambda: BusConfig(data_bitrate=8_000_001), "data_bitrate = 8000001"),
        (lambda: E2eConfig(min_ok=6), "min_ok = 6"),
        (lambda: E2eConfig(max_errors=5), "max_errors = 5"),
        (lambda: E2eConfig(max_delta=128), "max_delta = 128"),
        (lambda: E2eConfig(window=0), "window = 0"),
    ],
)
def test_value_out_of_range_is_refused_by_name(build, culprit):
    with pytest.raises(ConfigError, match=culprit):
        build()


def test_defaults_are_the_papers():
    config = Config()
    assert (config.model.window, config.model.latent, config.mpc.horizon, config.mpc.iterations) == (32, 8, 25, 5)
    assert config.flow.action_limit == 0.075
    assert config.period_ns == 20_000_000


def test_weights_keep_declaration_order():
    weights = CostWeights(**{field.name: float(i) for i, field in enumerate(fields(CostWeights))})
    assert weights.as_tuple() == tuple(map(float, range(len(fields(CostWeights)))))


def test_a_section_is_called_by_its_place_in_the_tree():
    def sections(tree: Any, above: str = ""):
        for field in fields(tree):
            value = getattr(tree, field.name)
            if is_dataclass(value):
                yield f"{above}{field.name}", value
                yield from sections(value, f"{above}{field.name}.")

    for name, section in sections(Config()):
        assert section.section == name


def test_a_bus_of_classic_frames_has_no_data_bit_rate_to_check():
    assert BusConfig(frames="classic", data_bitrate=1).data_bitrate == 1
