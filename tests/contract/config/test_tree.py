import math
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import pytest

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig, TrainConfig
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
    for name, group in groups(Config()):
        assert group.section == name
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


def test_a_rule_holds_up_to_its_bound_and_no_further():
    bounds: list[tuple[type[Any], str, object, object, str]] = [
        (OperatingPoint, "speed", 1000.0, 1001.0, r"in 0\.01\.\.1000"),
        (FlowConfig, "action_limit", 1e-12, 0.0, "positive"),
        (FlowConfig, "substeps", 10_000, 10**12, r"in 1\.\.10000: more take hours"),
        (EcuConfig, "rearm_frames", 1, 0, "at least 1"),
        (EcuConfig, "loss_limit", 50, 51, r"in 1\.\.loss_window"),
        (ModelConfig, "dropout", math.nextafter(1.0, 0.0), 1.0, r"in \[0, 1\)"),
        (MpcConfig, "horizon", 2, 1, "at least 2"),
        (TrainConfig, "batch_size", 2, 1, "at least 2, for the variance over a batch"),
        (BusConfig, "data_bitrate", 500_000, 499_999, r"in nominal_bitrate\.\.8000000"),
        (E2eConfig, "min_ok", 5, 6, r"in 1\.\.window"),
        (E2eConfig, "max_delta", 127, 128, r"in 1\.\.127"),
    ]
    for kind, name, good, bad, must in bounds:
        assert getattr(kind(**{name: good}), name) == good
        with pytest.raises(ConfigError, match=rf"\.{name} = {re.escape(repr(bad))}: must be {must}"):
            kind(**{name: bad})
    assert BusConfig(frames="classic", data_bitrate=1).data_bitrate == 1, "classic frames have no data bit rate"
