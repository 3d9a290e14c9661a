"""Runs as values: their settings, seeds and hashes."""

from dataclasses import replace
from typing import Any

import pytest

from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import ConfigError
from firmware_sim.bench.spans import Spans
from firmware_sim.campaign.running import RunTask, seed_of, settings_of
from tests.firmware_sim.campaign.conftest import scenario_of

TASK = RunTask(
    name="one",
    disturb=("noise:level=0.5",),
    config=Config(),
    controlled=True,
    phase=0,
    seed=1,
    timing=Spans(averages=False, lead_in=7.0, controlled=60.0, settle=20.0),
)


def test_a_scenarios_settings_go_on_top_and_a_wrong_one_is_refused_with_its_name() -> None:
    base = Config(ecu=EcuConfig(hold_periods=2))
    config = settings_of(scenario_of("late", settings=("ecu.delay_steps=12", "bus.background.load=0.9")), base)
    assert (config.ecu.delay_steps, config.ecu.hold_periods, config.bus.background.load) == (12, 2, 0.9)
    assert settings_of(scenario_of("none"), base) == base
    box = settings_of(scenario_of("box", disturb=("body:length=1",), settings=("flow.substeps=45",)), base)
    square = replace(base.body, length=1.0, leading_edge_radius=0.0)
    assert box == replace(base, body=square, flow=replace(base.flow, substeps=45))
    for text in ["ecu.delay=1", "ecu.delay_steps=-1", "flow.action_limit=0.1", "train.epochs=3", "nonsense"]:
        with pytest.raises(ConfigError, match="scenario 'wrong': "):
            settings_of(scenario_of("wrong", settings=(text,)), Config())


def test_whatever_decides_a_run_is_in_its_key_and_its_name_is_not() -> None:
    changes: list[dict[str, Any]] = [
        {"disturb": ("noise:level=0.6",)},
        {"config": Config(ecu=EcuConfig(delay_steps=1))},
        {"controlled": False},
        {"seed": 2},
        {"timing": replace(TASK.timing, settle=30.0)},
    ]
    keys = [replace(TASK, **change).key("b", "s", "1") for change in ({}, *changes)]
    keys += [TASK.key(*others) for others in (("c", "s", "1"), ("b", "t", "1"), ("b", "s", "2"))]
    assert len(set(keys)) == len(keys)
    assert replace(TASK, name="other").key("b", "s", "1") == keys[0]
    seeds = {seed_of(seed, name, phase) for seed in (0, 1) for name in ("a", "b") for phase in range(3)}
    assert len(seeds) == 12 and all(0 <= seed < 2**32 for seed in seeds)
