"""What is made from the sources lists all that the sources have, and texts beside it have the same numbers."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import fields
from itertools import groupby
from pathlib import Path

import pytest
from cantools.database import Database

from can_bridge.bus.faults.text import BUS_FAULTS
from can_bridge.uds.services import Nrc
from contract.config.loading import leaves, load_config, to_tree
from docs import can_messages, command_line, diagnosis, rooms, settings, states
from docs.made import PLACE, parts
from docs.site import api, source
from ecu.fail_safe import TRANSITIONS, OperatingMode
from firmware_sim.bench.disturbances import KINDS
from firmware_sim.bench.sensor_faults import GLOBAL_DEVIATION

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow  # reads every file
def test_the_picture_of_the_rooms_is_up_to_date():
    assert rooms.PICTURE.read_text(encoding="utf-8") == rooms.draw(), "docs/rooms.svg is stale: run `make generated`"


def test_every_public_module_is_on_one_page_of_the_site():
    public = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for package in source.PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if not path.name.startswith("_") and (path.parent / "__init__.py").exists()
    }
    assert sorted(f"{folder}.{name}" for folder, names in api.folders() for name in names) == sorted(public)


def test_every_part_that_is_made_has_one_place():
    pages = (page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md"))
    assert sorted(name for page in pages for name in PLACE.findall(page)) == sorted(parts())


def sections(page: str, heading: str) -> dict[str, str]:
    return dict(zip(*[iter(re.split(heading, page, flags=re.MULTILINE)[1:])] * 2, strict=True))


def test_every_signal_of_the_dbc_is_where_the_page_has_it():
    dbc = Database()
    dbc.add_dbc_string(can_messages.DBC.read_text(encoding="utf-8"))
    header, *_ = can_messages.signals().partition("\n## ")
    by_message = sections(can_messages.signals(), r"^## (\w+)\n")
    for message in dbc.messages:
        assert f"`{message.name}` {message.frame_id:#x}, {message.length}, " in can_messages.sets()
        (name, form), *_ = re.findall(r"^(\w+?)(Classic|Secured|)$", message.name)
        signals = message.signals
        if form == "Secured":
            *signals, freshness, mac = signals
            assert f"| {message.name} | {freshness.start} | {mac.start} |" in can_messages.trailers()
        for _, group in groupby(signals, key=lambda one: one.name.rstrip("0123456789")):
            first, *others = group
            (row,) = re.findall(rf"^\| `{first.name}`.*[^,;] \|$", header + by_message[name], re.MULTILINE)
            starts = "/".join(str(one.start) for one in (first, *others))
            place = f"{starts}, {'int' if first.is_signed else 'uint'}{first.length}"
            assert re.match(rf"{place}\b", row.split(" | ")[2 if form == "Classic" else 1]), (message.name, row)


def test_every_command_has_a_section_with_the_options_of_its_help(cli):
    by_command = sections(command_line.sections(), r"^####? stillwake (.+)\n")
    groups = {name.split()[0] for name in command_line.commands() if " " in name}
    assert by_command.keys() == command_line.commands().keys() | groups
    common = set(re.findall(r"^- `(--[\w-]+)", command_line.common_options(), re.MULTILINE))
    for name in ("run", "latency", "can send"):
        boxes = [line for line in cli(*name.split(), "--help").out.splitlines() if line.startswith("│ --")]
        shown = {line.split()[1] for line in boxes} - {"--help"}
        assert len(shown) > 3, name
        own = set(re.findall(r"^- `(--[\w-]+)", by_command[name], re.MULTILINE))
        also = set(re.findall(r"`(--[\w-]+)`", by_command[name].partition("\nAlso ")[2]))
        assert own | also == shown and also <= common, name
    assert "`--lead-in` (25)" in by_command["run"]
    assert "- `--lead-in NUMBER` (≥0.2): Time without control, t_c." in command_line.common_options()


def test_numbers_in_texts_are_those_of_the_ecu():
    for module, name in ((diagnosis, "diagnosis"), (states, "states")):
        text = " ".join((ROOT / "docs" / "reference" / f"{name}.md").read_text(encoding="utf-8").split())
        assert [phrase for phrase in module.STATED if phrase not in text] == []


def test_a_negative_response_is_left_out_only_where_no_answer_of_the_ecu_has_it():
    folders = (ROOT / "can_bridge", ROOT / "ecu")
    sources = [path for folder in folders for path in folder.rglob("*.py") if "tester" not in path.parts]
    sent = {name for path in sources for name in re.findall(r"\bNrc\.([A-Z_]+)", path.read_text(encoding="utf-8"))}
    assert {one.name for one in Nrc} - sent == {one.name for one in diagnosis.UNSENT}


def test_every_setting_has_a_line_with_default_release_unit_bounds_source_and_meaning():
    lines = {line.split("`")[1]: line for line in settings.lists().splitlines() if line.startswith("- `")}
    assert sorted(lines) == sorted(dict(leaves(to_tree(load_config()))))
    assert lines["train.epochs"].startswith("- `train.epochs` 300 passes, release 40: Passes over the windows")
    assert "(shap, qr, greedy, random, hand), release greedy: " in lines["train.selection"]
    assert lines["train.selection"].endswith("(paper, section 2.3.1)")
    assert lines["bus.e2e.window"].startswith("- `bus.e2e.window` 5 frames: Number of latest check results")


def test_every_kind_of_disturbance_has_a_row_with_its_parameters():
    page = (ROOT / "docs" / "reference" / "disturbances.md").read_text(encoding="utf-8")
    elsewhere, of_the_bus = page.partition("## Faults of the bus")[::2]
    rows = {re.split(r"\W", row[3:])[0]: row for row in elsewhere.splitlines() if row.startswith("- `")}
    assert sorted(rows) == sorted(KINDS)
    assert set(re.findall(r"^- `(\w+)", of_the_bus, re.MULTILINE)) == BUS_FAULTS.keys()
    for name, kind in KINDS.items():
        # The only node that a reset or a clock can be of need not be named.
        unnamed = {"start_s", "end_s"} | ({"node"} if name in ("reset", "clock") else set())
        for parameter in {field.name for field in fields(kind)} - unnamed:
            assert f"{parameter}=" in rows[name], f"{name}: {parameter}"
    assert f"{GLOBAL_DEVIATION} in Cp" in page


def test_the_picture_of_states_is_up_to_date_with_every_state_and_transition():
    assert states.PICTURE.read_text(encoding="utf-8") == states.draw(), "docs/states.svg is stale: run `make generated`"
    meanings = re.findall(r"^- ([A-Z]+) \([A-Z]+, jets (?:shut|may run)\): \S", states.states(), flags=re.MULTILINE)
    assert meanings == [mode.name for mode in OperatingMode]
    texts = [item.text or "" for item in ElementTree.fromstring(states.draw()).iter("{http://www.w3.org/2000/svg}text")]
    assert {*texts} >= {mode.name for mode in OperatingMode}
    spans = [span for text in texts for span in re.findall(r"(\d+)(?:-(\d+))?", text)]
    numbers = {number for first, last in spans for number in range(int(first), int(last or first) + 1)}
    assert numbers == {number for number, row in enumerate(TRANSITIONS, start=1) if row.start != {row.to}}
