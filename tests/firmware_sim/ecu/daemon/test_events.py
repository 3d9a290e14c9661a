"""Lines of the log."""

import json
from datetime import UTC, datetime

from firmware_sim.ecu.daemon.events import Event, as_json, plain

# 2026-03-29T01:00:00Z, when summer time begins in Europe: dates are UTC.
WHEN = 1_774_746_000_000_000_000


def test_a_plain_line():
    event = Event(date_ns=WHEN + 7_999_999, name="bus_lost", text="bus lost:\n  it's gone")
    assert plain(event) == "01:00:00.007 ecu: bus lost: it's gone"


def test_json_is_read_back_by_another_parser():
    event = Event(date_ns=WHEN + 123_456_789, name="mode", text='a "b"\n', fields={"mode": "OFF", "n": 3, "s": 0.5})
    line = as_json(event)
    assert "\n" not in line
    read = json.loads(line)
    assert datetime.fromisoformat(read.pop("time")) == datetime(2026, 3, 29, 1, 0, 0, 123_456, UTC)
    assert read == {"event": "mode", "text": 'a "b"\n', "mode": "OFF", "n": 3, "s": 0.5}
