"""The pages that are made from the sources are as the sources are, and list all that the sources have."""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from cantools.database import Database

from can_bridge.bus.faults.text import KINDS as BUS_FAULTS
from can_bridge.calibration.xcp import Command
from can_bridge.uds.services import Did, Nrc, Routine, Service
from contract.config.loading import load_config, to_tree
from contract.config.tree import Config
from docs import can_messages, command_line, diagnosis, settings, states
from ecu.fail_safe import TRANSITIONS, OperatingMode
from firmware_sim.bench.disturbances import KINDS, Disturbances
from firmware_sim.bench.sensor_faults import GLOBAL_DEVIATION

ROOT = Path(__file__).resolve().parents[2]


def test_they_are_up_to_date():
    for made in (can_messages, command_line, diagnosis, settings, states):
        assert made.PAGE.read_text(encoding="utf-8") == made.page(), f"{made.PAGE} is stale: run `make generated`"
    assert states.PICTURE.read_text(encoding="utf-8") == states.draw(), "docs/states.svg is stale: run `make generated`"


def sections(page: str, heading: str) -> dict[str, str]:
    return dict(zip(*[iter(re.split(heading, page, flags=re.MULTILINE)[1:])] * 2, strict=True))


def test_every_message_and_signal_of_the_dbc_has_a_line():
    dbc = Database()
    dbc.add_dbc_string(can_messages.DBC.read_text(encoding="utf-8"))
    by_message = sections(can_messages.page(), r"^### (\w+)\n")
    assert by_message.keys() == {message.name for message in dbc.messages}
    for message in dbc.messages:
        rows = re.findall(r"^\| `(\w+)` \| (\d+), (\d+)", by_message[message.name], flags=re.MULTILINE)
        assert rows == [(item.name, str(item.start), str(item.length)) for item in message.signals]


def test_every_command_has_a_section_with_the_options_of_its_help(cli):
    by_command = sections(command_line.page(), r"^####? stillwake (.+)\n")
    groups = {name.split()[0] for name in command_line.commands() if " " in name}
    assert by_command.keys() == command_line.commands().keys() | groups
    for name in ("run", "latency", "can send"):
        boxes = [line for line in cli(*name.split(), "--help").out.splitlines() if line.startswith("│ --")]
        shown = {line.split()[1] for line in boxes} - {"--help"}
        assert len(shown) > 3, name
        assert set(re.findall(r"^\| `(--[\w-]+)", by_command[name], re.MULTILINE)) == shown, name
    assert "| `--lead-in` | `NUMBER`, at least 0.2 | `25` | Time without control, t_c. |" in by_command["run"]


def test_every_number_of_diagnosis_has_a_line():
    unsent = {f"{one:02X}" for one in diagnosis.UNSENT}
    for heading, numbers in (
        ("Services", {f"{one:02X}" for one in Service}),
        ("Identifiers", {f"{one:04X}" for one in Did}),
        ("Routines", {f"{one:04X}" for one in Routine}),
        ("Negative responses", {f"{one:02X}" for one in Nrc} - unsent),
        ("XCP", {f"{one:02X}" for one in Command}),
    ):
        text = diagnosis.page().partition(f"## {heading}\n")[2].partition("\n## ")[0]
        assert set(re.findall(r"^\| `([0-9A-F]+)` \|", text, re.MULTILINE)) == numbers, heading


def test_a_negative_response_is_left_out_only_where_no_answer_of_the_ecu_has_it():
    folders = (ROOT / "can_bridge", ROOT / "ecu")
    sources = [path for folder in folders for path in folder.rglob("*.py") if "tester" not in path.parts]
    sent = {name for path in sources for name in re.findall(r"\bNrc\.([A-Z_]+)", path.read_text(encoding="utf-8"))}
    assert {one.name for one in Nrc} - sent == {one.name for one in diagnosis.UNSENT}


def test_every_setting_has_a_line_with_default_release_unit_bounds_source_and_meaning():
    def leaves(prefix: str, tree: dict[str, Any]) -> Iterator[str]:
        for name, value in tree.items():
            full = f"{prefix}.{name}".lstrip(".")
            yield from leaves(full, value) if isinstance(value, dict) else [full]

    rows = [row for row in settings.page().splitlines() if row.startswith("| `")]
    lines = {row.split("`")[1]: [cell.strip() for cell in row.split(" | ")] for row in rows}
    assert sorted(lines) == sorted(leaves("", to_tree(load_config())))
    assert lines["train.epochs"][1:6] == ["300", "40", "passes", "positive", "paper, section 2.2.4"]
    assert lines["train.selection"][4] == "shap, qr, greedy, random, hand"
    assert lines["bus.e2e.window"][6] == "Latest checks that are judged together. |"


def test_every_kind_of_disturbance_has_a_row_with_its_parameters():
    page = (ROOT / "docs" / "reference" / "disturbances.md").read_text(encoding="utf-8")
    elsewhere, of_the_bus = page.partition("## Faults of the bus")[::2]
    rows = {re.split(r"\W", row[3:])[0]: row for row in elsewhere.splitlines() if row.startswith("| `")}
    assert sorted(rows) == sorted(KINDS)
    assert set(re.findall(r"^\| `(\w+)", of_the_bus, re.MULTILINE)) == BUS_FAULTS.keys()
    for name, kind in KINDS.items():
        # The only node that a reset or a clock can be of need not be named.
        unnamed = {"start_s", "end_s"} | ({"node"} if name in ("reset", "clock") else set())
        for parameter in {field.name for field in fields(kind)} - unnamed:
            assert f"{parameter}=" in rows[name], f"{name}: {parameter}"
    assert f"{GLOBAL_DEVIATION} in Cp" in page
    texts = re.findall(r"--disturb (\S+=\S+)", page)
    assert len(texts) >= 2
    Disturbances.parse(texts).check(Config(), ("upper_39", "lower_39", "base_0", "base_9"), duration_s=12.5)


def test_states_and_their_picture_have_every_state_and_transition():
    meanings = re.findall(r"^\| ([A-Z]+) \| [A-Z]+ \| (?:shut|may run) \| \S.*\|$", states.page(), flags=re.MULTILINE)
    assert meanings == [mode.name for mode in OperatingMode]
    rows = re.findall(r"^\| (\d+) \|", states.page(), flags=re.MULTILINE)
    assert [int(number) for number in rows] == [*range(1, len(TRANSITIONS) + 1)]
    texts = [item.text or "" for item in ElementTree.fromstring(states.draw()).iter("{http://www.w3.org/2000/svg}text")]
    assert {*texts} >= {mode.name for mode in OperatingMode}
    spans = [span for text in texts for span in re.findall(r"(\d+)(?:-(\d+))?", text)]
    numbers = {number for first, last in spans for number in range(int(first), int(last or first) + 1)}
    assert numbers == {number for number, row in enumerate(TRANSITIONS, start=1) if row.start != {row.to}}


def test_a_picture_of_states_that_lacks_or_invents_a_transition_is_an_error(monkeypatch):
    with monkeypatch.context() as patch:
        added = replace(TRANSITIONS[0], start=frozenset({OperatingMode.STANDBY}), to=OperatingMode.CONTROL)
        patch.setattr(states, "TRANSITIONS", (*TRANSITIONS, added))
        with pytest.raises(ValueError, match=r"missing \[\('STANDBY', 'CONTROL'\)\]"):
            states.draw()
    monkeypatch.setattr(states, "LINES", (*states.LINES, states.Line("UPDATE", "INIT", ((0, 0), (1, 1)), (0, 0))))
    with pytest.raises(ValueError, match=r"too many \[\('UPDATE', 'INIT'\)\]"):
        states.draw()
