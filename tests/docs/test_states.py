"""The page of states and its picture are what the table has."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import pytest

from docs import states
from firmware_sim.ecu.state_machine import TRANSITIONS, OperatingMode

SVG = "{http://www.w3.org/2000/svg}"


def test_page_and_picture_are_up_to_date():
    assert states.PAGE.read_text(encoding="utf-8") == states.page(), (
        "docs/reference/states.md is stale: run `make generated`"
    )
    assert states.PICTURE.read_text(encoding="utf-8") == states.draw(), "docs/states.svg is stale: run `make generated`"


def test_every_state_has_a_meaning_and_every_row_a_line():
    page = states.PAGE.read_text(encoding="utf-8")
    meanings = re.findall(r"^\| ([A-Z]+) \| [A-Z]+ \| (?:shut|may run) \| \S.*\|$", page, flags=re.MULTILINE)
    assert meanings == [mode.name for mode in OperatingMode]
    assert [int(number) for number in re.findall(r"^\| (\d+) \|", page, flags=re.MULTILINE)] == [
        *range(1, len(TRANSITIONS) + 1)
    ]


def test_the_picture_has_every_row_that_leads_to_another_state():
    texts = [item.text or "" for item in ElementTree.fromstring(states.draw()).iter(f"{SVG}text")]
    assert {*texts} >= {mode.name for mode in OperatingMode}
    numbers = set[int]()
    for text in texts:
        for first, last in re.findall(r"(\d+)(?:-(\d+))?", text):
            numbers |= {*range(int(first), int(last or first) + 1)}
    leading = {number for number, row in enumerate(TRANSITIONS, start=1) if row.start != {row.to}}
    assert numbers == leading


def test_a_transition_without_a_line_is_an_error(monkeypatch):
    standby = frozenset({OperatingMode.STANDBY})
    added = replace(TRANSITIONS[0], start=standby, to=OperatingMode.ACTIVE)
    monkeypatch.setattr(states, "TRANSITIONS", (*TRANSITIONS, added))
    with pytest.raises(ValueError, match=r"missing \[\('STANDBY', 'ACTIVE'\)\]"):
        states.draw()


def test_a_line_without_a_transition_is_an_error(monkeypatch):
    monkeypatch.setattr(states, "LINES", (*states.LINES, states.Line("UPDATE", "INIT", ((0, 0), (1, 1)), (0, 0))))
    with pytest.raises(ValueError, match=r"too many \[\('UPDATE', 'INIT'\)\]"):
        states.draw()
