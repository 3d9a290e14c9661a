"""What is reported of the ECU, and what comes of it where nothing can be written; its file for Prometheus."""

import json
import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from can_bridge.bus.interface import BusHealth
from can_bridge.wire.messages import Mode, Reason
from contract.errors import BusError
from ecu.daemon.reporter import Counters, DatedEvent, Reporter, as_json, plain, text
from ecu.ecu_state import EcuState
from ecu.pressure_reception import OtherEcu
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


def test_what_cannot_be_written_or_kept_is_reported_once_and_once_when_it_can(tmp_path, counters):
    lines: list[str] = []
    folder = tmp_path / "metrics"
    folder.write_text("a file where a folder must be")
    looks = list[Counters]()

    def keep(given: Counters) -> None:
        looks.append(given)
        if len(looks) < 3:
            raise BusError("cannot write x: no space")

    metrics = folder / "ecu.prom"
    with Reporter(lines.append, by_name, bundle="", metrics=metrics, keep=keep, interval_s=OFTEN_S) as reporter:
        reporter.counters = counters
        wait_for(lambda: len(looks) > 5)
        folder.unlink()
        wait_for(metrics.exists)
        seen = len(looks)
        wait_for(lambda: len(looks) > seen + 2)
    names = [line.split(": ")[0] for line in lines]
    assert names == ["metrics_failed", "freshness_failed", "freshness_written", "metrics_written"]
    assert "cannot write" in lines[0] and lines[1] == "freshness_failed: cannot write x: no space"
    assert [path.name for path in folder.iterdir()] == ["ecu.prom"]


def test_what_happens_every_period_is_a_line_an_interval_and_all_is_written_before_it_ends(counters):
    lines: list[str] = []
    with Reporter(lines.append, by_name, bundle="", interval_s=3600.0) as reporter:
        for left_out in range(1, 50):
            reporter.tell("a", str(left_out))
            reporter.counters = replace(counters, left_out=left_out, not_sent=2 * left_out)
    left_out_line = "left_out: 49 periods left out, 49 in all"
    assert lines == [*(f"a: {n}" for n in range(1, 50)), left_out_line, "not_sent: 98 frames not sent, 98 in all"]


# 2026-03-29T01:00:00Z, when summer time begins in Europe: dates are UTC.
WHEN = 1_774_746_000_000_000_000


def test_an_event_is_a_plain_line_or_one_of_json():
    event = DatedEvent(date_ns=WHEN + 7_999_999, name="bus_lost", text="bus lost:\n  it's gone", fields={})
    assert plain(event) == "01:00:00.007 ecu: bus lost: it's gone"
    # JSON is read back by another parser.
    fields: dict[str, str | int | float] = {"mode": "OFF", "n": 3, "s": 0.5}
    line = as_json(DatedEvent(date_ns=WHEN + 123_456_789, name="mode", text='a "b"\n', fields=fields))
    assert "\n" not in line
    read = json.loads(line)
    assert datetime.fromisoformat(read.pop("time")) == datetime(2026, 3, 29, 1, 0, 0, 123_456, UTC)
    assert read == {"event": "mode", "text": 'a "b"\n', **fields}


NAME = r"[a-zA-Z_:][a-zA-Z0-9_:]*"
LABEL = r'[a-zA-Z_][a-zA-Z0-9_]*="(?:[^"\\\n]|\\["\\n])*"'
SAMPLE = re.compile(rf"({NAME})(?:\{{({LABEL}(?:,{LABEL})*)\}})? (\S+)")


def read(content: str) -> dict[tuple[str, str], float]:
    """Samples by name and labels; every line must be one of the format's, each metric with its type before it."""
    assert content.endswith("\n")
    samples, typed = {}, {}
    for line in content.splitlines():
        if line.startswith("# HELP "):
            continue
        if match := re.fullmatch(rf"# TYPE ({NAME}) (counter|gauge)", line):
            assert match[1] not in typed
            typed[match[1]] = match[2]
            continue
        match = SAMPLE.fullmatch(line)
        assert match is not None, line
        assert match[1] in typed
        assert (typed[match[1]] == "counter") == match[1].endswith("_total")
        samples[match[1].removeprefix("stillwake_ecu_"), match[2] or ""] = float(match[3])
    return samples


def test_every_number_stands_under_its_name_and_one_mode_and_one_reason_are_on():
    power_on = EcuState.power_on(window=4, sensors=4, horizon=5, delay=1)
    health, other = BusHealth(bus_off=9, tx_errors=10, rx_errors=11), OtherEcu(frames=12)
    fault = power_on.fail_safe.latch(Reason.BUS_OFF)
    state = replace(power_on, overruns=7, missed=8, health=health, fail_safe=fault, other_ecu=other)
    counts = {"steps": 1, "left_out": 2, "received": 3, "dropped": 4, "not_sent": 5, "losses": 6}
    times = {"busy_ns": 1_500_000_000, "longest_ns": 16_000_000, "latest_wake_ns": 1}
    counters = Counters(state=state, action=-0.025, **counts, **times)
    # A bundle may have any name.
    samples = read(text(counters, bundle='a "b"\\\nc'))
    counted = (
        *("steps_total", "periods_left_out_total", "frames_received_total", "frames_dropped_total"),
        *("frames_not_sent_total", "bus_losses_total", "overruns_total", "missed_total", "bus_off_total"),
        *("tx_errors", "rx_errors", "other_ecu_frames_total"),
    )
    seconds = {"busy_seconds_total": 1.5, "longest_step_seconds": 0.016, "latest_wake_seconds": 1e-9}
    expected = dict(zip(counted, range(1, 13), strict=True)) | seconds | {"action": -0.025}
    assert {name: samples[name, ""] for name in expected} == expected
    assert samples["info", r'bundle="a \"b\"\\\nc"'] == 1
    modes = {label: value for (name, label), value in samples.items() if name == "mode"}
    reasons = {label: value for (name, label), value in samples.items() if name == "reason"}
    assert (len(modes), len(reasons)) == (len(Mode), len(Reason))
    assert [label for label, value in modes.items() if value] == ['mode="FAULT"']
    assert [label for label, value in reasons.items() if value] == ['reason="BUS_OFF"']
