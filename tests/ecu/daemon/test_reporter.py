"""What is reported of the ECU, and what comes of it where nothing can be written."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from contract.errors import BusError
from ecu.daemon.counters import Counters
from ecu.daemon.reporter import DatedEvent, Reporter, as_json, plain
from ecu.ecu_state import EcuState
from tests.ecu.daemon.conftest import wait_for

OFTEN_S = 0.01


def by_name(event: DatedEvent) -> str:
    return f"{event.name}: {event.text}"


@pytest.fixture
def counters() -> Counters:
    return Counters(state=EcuState.power_on(window=4, sensors=4, horizon=5, delay=1), steps=3)


def test_a_full_disk_under_the_log_costs_lines_and_nothing_else(tmp_path: Path, counters: Counters):
    metrics = tmp_path / "ecu.prom"
    with open("/dev/full", "w") as full:

        def write(line: str) -> None:
            full.write(f"{line}\n")
            full.flush()

        with Reporter(write, by_name, bundle="", metrics=metrics, interval_s=OFTEN_S) as reporter:
            reporter.tell("a", "b")
            reporter.counters = counters
            wait_for(metrics.exists)
        # What could not be written is still in the file object's buffer.
        with pytest.raises(OSError, match="No space left"):
            full.close()


def test_a_file_of_counters_that_cannot_be_written_is_reported_once_and_once_when_it_can(tmp_path, counters):
    lines: list[str] = []
    folder = tmp_path / "metrics"
    folder.write_text("a file where a folder must be")
    looks = list[Counters]()
    reporter = Reporter(
        lines.append, by_name, bundle="", metrics=folder / "ecu.prom", keep=looks.append, interval_s=OFTEN_S
    )
    with reporter:
        reporter.counters = counters
        wait_for(lambda: len(looks) > 5)
        folder.unlink()
        wait_for((folder / "ecu.prom").exists)
        seen = len(looks)
        wait_for(lambda: len(looks) > seen + 2)
    assert [line.split(": ")[0] for line in lines] == ["metrics_failed", "metrics_written"]
    assert "cannot write" in lines[0]
    assert [path.name for path in folder.iterdir()] == ["ecu.prom"]


def test_what_happens_every_period_is_a_line_an_interval_and_all_is_written_before_it_ends(counters):
    lines: list[str] = []
    with Reporter(lines.append, by_name, bundle="", interval_s=3600.0) as reporter:
        for left_out in range(1, 50):
            reporter.tell("a", str(left_out))
            reporter.counters = replace(counters, left_out=left_out, not_sent=2 * left_out)
    left_out_line = "left_out: 49 periods left out, 49 in all"
    assert lines == [*(f"a: {n}" for n in range(1, 50)), left_out_line, "not_sent: 98 frames not sent, 98 in all"]


def test_what_must_be_kept_and_cannot_is_reported(counters):
    lines: list[str] = []

    def keep(given: Counters) -> None:
        assert given is counters
        raise BusError("cannot write x: no space")

    with Reporter(lines.append, by_name, bundle="", keep=keep, interval_s=OFTEN_S) as reporter:
        reporter.counters = counters
        wait_for(lambda: lines)
    assert lines == ["freshness_failed: cannot write x: no space"]


# 2026-03-29T01:00:00Z, when summer time begins in Europe: dates are UTC.
WHEN = 1_774_746_000_000_000_000


def test_an_event_is_a_plain_line_or_one_of_json():
    event = DatedEvent(date_ns=WHEN + 7_999_999, name="bus_lost", text="bus lost:\n  it's gone", fields={})
    assert plain(event) == "01:00:00.007 ecu: bus lost: it's gone"
    # JSON is read back by another parser.
    event = DatedEvent(
        date_ns=WHEN + 123_456_789, name="mode", text='a "b"\n', fields={"mode": "OFF", "n": 3, "s": 0.5}
    )
    line = as_json(event)
    assert "\n" not in line
    read = json.loads(line)
    assert datetime.fromisoformat(read.pop("time")) == datetime(2026, 3, 29, 1, 0, 0, 123_456, UTC)
    assert read == {"event": "mode", "text": 'a "b"\n', "mode": "OFF", "n": 3, "s": 0.5}
