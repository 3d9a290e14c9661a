"""The page of CAN messages is what the DBC has, and lists all of it."""

import re

from cantools.database import Database

from docs import can_messages

DBC = Database()
DBC.add_dbc_string(can_messages.DBC.read_text(encoding="utf-8"))
PAGE = can_messages.PAGE.read_text(encoding="utf-8")


def test_the_page_is_up_to_date():
    assert can_messages.page() == PAGE, "docs/reference/can-messages.md: run `make generated`"


def test_every_message_and_signal_has_a_line():
    sections = dict(zip(*[iter(re.split(r"^### (\w+)\n", PAGE, flags=re.MULTILINE)[1:])] * 2, strict=True))
    assert sections.keys() == {message.name for message in DBC.messages}
    for message in DBC.messages:
        found = re.findall(r"^\| `(\w+)` \| (\d+), (\d+)", sections[message.name], flags=re.MULTILINE)
        assert found == [(item.name, str(item.start), str(item.length)) for item in message.signals]
