"""The page of disturbances has every kind, its parameters, and the unit of the levels."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from contract.config.tree import Config
from firmware_sim.bench.disturbances import GLOBAL_DEVIATION, KINDS, Disturbances

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "disturbances.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| `(\w+)[^`]*`", PAGE, flags=re.MULTILINE)


def test_every_kind_has_a_row():
    assert sorted(ROWS) == sorted(KINDS)


@pytest.mark.parametrize("name", KINDS)
def test_every_parameter_is_in_its_row(name):
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{name}"))
    for field in fields(KINDS[name]):
        # The only node that a reset or a clock can be of need not be named.
        if field.name not in ("start_s", "end_s") and (name, field.name) not in {("reset", "node"), ("clock", "node")}:
            assert f"{field.name}=" in row


def test_the_unit_of_levels_is_stated():
    assert f"{GLOBAL_DEVIATION} in Cp" in PAGE


def test_examples_can_act():
    texts = re.findall(r"--disturb (\S+=\S+)", PAGE)
    assert len(texts) >= 2
    sensors = ("lower_36", "base_7", "upper_39", "base_0")
    Disturbances.parse(texts).check(Config(), sensors, duration_s=12.5)
