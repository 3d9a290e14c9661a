"""The page of diagnosis is what the server has, and has a line for all of it."""

import re
from pathlib import Path

import pytest

from can_bridge.calibration.xcp import Command
from can_bridge.uds.services import Did, Nrc, Routine, Service
from docs import diagnosis

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_is_up_to_date():
    assert diagnosis.PAGE.read_text(encoding="utf-8") == diagnosis.page(), (
        "docs/reference/diagnosis.md is stale: run `make generated`"
    )


@pytest.mark.parametrize(
    ("heading", "numbers"),
    [
        ("Services", {f"{one:02X}" for one in Service}),
        ("Identifiers", {f"{one:04X}" for one in Did}),
        ("Routines", {f"{one:04X}" for one in Routine}),
        ("Negative responses", {f"{one:02X}" for one in Nrc} - {f"{one:02X}" for one in diagnosis.UNSENT}),
        ("XCP", {f"{one:02X}" for one in Command}),
    ],
)
def test_every_number_has_a_line(heading, numbers):
    text = diagnosis.page().partition(f"## {heading}\n")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `([0-9A-F]+)` \|", text, re.MULTILINE)) == numbers


def test_a_code_is_left_out_only_where_no_answer_has_it():
    """By the sources of the ECU's side: what it refuses by is on the page."""
    folders = (ROOT / "can_bridge", ROOT / "firmware_sim" / "ecu")
    sources = [path for folder in folders for path in folder.rglob("*.py") if "tester" not in path.parts]
    sent = {name for path in sources for name in re.findall(r"\bNrc\.([A-Z_]+)", path.read_text(encoding="utf-8"))}
    assert {one.name for one in Nrc} - sent == {one.name for one in diagnosis.UNSENT}
