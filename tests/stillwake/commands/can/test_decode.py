"""`stillwake can decode` and `monitor`: lines, summary, CSV and JSON of logs, and the live view, whole at 80
columns and with what fails in red."""

import csv
import json
import sys
from io import StringIO
from itertools import count
from threading import Event, Thread

import can
import pytest
from rich.console import Console
from rich.text import Text

from can_bridge.bus.conversion import to_message
from can_bridge.tools.traffic import Summary
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, SPECS
from stillwake.commands.can.monitor import STALE_S, line, screen
from tests.can_bridge.drives.drive_log import at
from tests.can_bridge.logs import log_texts
from tests.can_bridge.logs.log_texts import asc, candump_l, frames
from tests.can_bridge.tools.test_traffic import frame, summary_of
from tests.stillwake.commands.can.virtual_bus import VIRTUAL, flat, taken, write


def rows_of(path, signal: str) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return [row for row in csv.DictReader(file) if row["signal"] == signal]


def test_decode_and_monitor_check_the_mac_with_a_key_and_report_without_one(printed, peer, tmp_path):
    """Three genuine frames and the first again, read with their key, with another one, and without."""
    for name in ("bus.key", "other.key"):
        printed("keygen", "--secret", tmp_path / name)
    setting = ("--set", f"bus.key={tmp_path / 'bus.key'}")
    printed("can", "send", "PressureSecured", "--count", 3, "--trip", 1, *setting, *VIRTUAL)
    frames, log = taken(peer), tmp_path / "signed.log"
    log_texts.write(log, [at(one, 100.0 + 0.02 * i) for i, one in enumerate([*frames, frames[0]])])
    fresh, forged, unchecked = ["OK"] * 3 + ["not fresh"], ["not authentic"] * 4, ["not checked"] * 4
    for key, counts, macs, e2e in (
        ("bus.key", {"OK": 3, "not fresh": 1}, fresh, ["E2E OK, "] * 3 + [""]),
        ("other.key", {"not authentic": 4}, forged, [""] * 4),
        (None, {"OK": 3, "wrong sequence": 1}, unchecked, ["E2E OK, "] * 3 + ["E2E wrong sequence, "]),
    ):
        ends = [f"{check}MAC {mac}]" for check, mac in zip(e2e, macs, strict=True)]
        used = () if key is None else ("--set", f"bus.key={tmp_path / key}")
        table, figures = tmp_path / f"{key}.csv", tmp_path / "a.json"
        decoded = printed("can", "decode", log, "--json", figures, "--csv", table, *used)
        (message,) = json.loads(figures.read_text())["figures"]["messages"]
        assert (message["checks"], message["mac_checked"]) == (counts, key is not None)
        assert ("MAC not checked: name the key" in decoded) is (key is None)
        assert [line.rpartition("[")[2] for line in decoded.splitlines() if "PressureSecured:" in line] == ends
        assert [row["mac"] for row in rows_of(table, "Pressure0")] == macs
        seen = printed("can", "monitor", log, *used)
        assert f" lost, {4 - counts.get('OK', 0)} refused" in seen, key
        assert list(counts)[-1] in flat(seen), key


def test_decode_prints_a_line_a_frame_and_a_summary_and_writes_a_row_a_signal(printed, refused, tmp_path):
    write(tmp_path / "a.blf", 3)
    decoded = printed("can", "decode", tmp_path / "a.blf", "--csv", tmp_path / "a.csv")
    lines = decoded.splitlines()
    assert lines[1].startswith("(1700000000.008000) 130 JetCommand: E2E_CRC=")
    assert lines[1].endswith("Flow=0 m2/s, PressureCounter=0  [E2E OK]")
    assert lines[3] == "(1700000000.012000) 18FEF100 unknown: 00 00 00 00 00 00 00 00"
    assert "130 JetCommand 3 50.00 0.008000 0.048000 0 OK 3" in flat(decoded)
    assert "12 data frames, 0 remote, 0 error frames in 0.052000 s from 1700000000.000000; bus load by" in decoded
    assert printed("can", "decode", tmp_path / "a.blf", "--summary").splitlines()[0].strip() == ""
    flows = rows_of(tmp_path / "a.csv", "Flow")
    assert [(row["time_s"], row["id"], row["e2e"], float(row["value"]), row["unit"]) for row in flows[:2]] == [
        ("1700000000.008000", "130", "OK", 0.0, "m2/s"),
        ("1700000000.028000", "130", "OK", pytest.approx(0.1), "m2/s"),
    ]
    sets = ("--set", "bus.diagnosis.xcp_command_id=0x18FEF100", "--set", "bus.diagnosis.xcp_response_id=0x18FEF101")
    named = printed("can", "decode", tmp_path / "a.blf", *sets)
    assert named.splitlines()[3] == "(1700000000.012000) 18FEF100 XCP command: 00 00 00 00 00 00 00 00"
    assert "give another name" in refused("can", "decode", tmp_path / "a.blf", "--csv", tmp_path / "a.csv")


def test_monitor_of_a_log_shows_its_end(printed, tmp_path):
    write(tmp_path / "a.asc", 20)
    seen = printed("can", "monitor", tmp_path / "a.asc")
    # The last frame is 3.5 ms behind the last status: 0.00 s old by the log's clock, at 50 a second.
    assert "EcuStatus 140 0.00 50.0 0 0 OK" in flat(seen)
    assert "80 frames, 0 lost, 0 refused" in seen
    only = printed("can", "monitor", tmp_path / "a.asc", "--filter", "flow")
    assert "Flow 1.9 m2/s" in flat(only)
    assert "Missed" not in only


def test_monitor_on_a_terminal_draws_over_its_picture_and_puts_the_cursor_back(cli, peer, monkeypatch):
    written = StringIO()
    terminal = Console(file=written, width=100, height=40, force_terminal=True, force_interactive=True)
    # The package has the function under the module's name.
    monkeypatch.setattr(sys.modules["stillwake.commands.can.monitor"], "console", terminal)

    is_over = Event()

    def send() -> None:
        for counter in count():
            peer.send(to_message(frame(JET_COMMAND, counter % 256)))
            if is_over.wait(0.02):
                break

    sending = Thread(target=send, daemon=True)
    sending.start()
    assert cli("can", "monitor", "--filter", "flow", "--for", 1, *VIRTUAL).code == 0
    is_over.set()
    sending.join()
    out = written.getvalue()
    assert "filter: flow" in out and "Flow" in out and "Enable" not in out
    assert "\x1b[1A" in out
    assert out.endswith("\n\x1b[?25h")


def test_the_summary_counts_what_is_no_frame_by_its_name_and_reads_each_bus_by_itself(cli, tmp_path):
    """A request is not on the bus; `tests/can_bridge/logs` has all that is no frame."""
    sent = frames()
    lines = asc(sent, requests=True)
    (tmp_path / "a.asc").write_text("\n".join(lines) + "\n")
    shown = cli("can", "decode", tmp_path / "a.asc", "--summary", "--json", tmp_path / "a.json").out
    assert "16 data frames, 0 remote, 0 error frames in 0.075000 s" in shown
    assert "lines that are not frames: transmit request 6" in shown
    figures = json.loads((tmp_path / "a.json").read_text())["figures"]
    assert figures["frames"] + sum(figures["events"].values()) == len(lines)
    errors = ["(0.2) can0 20000004#0004000000000000", "(0.3) can0 20000088#00"]
    lines = [errors[0], *candump_l(sent), *candump_l(sent, "can1"), errors[1]]
    (tmp_path / "two.log").write_text("\n".join(lines) + "\n")
    both = flat(cli("can", "decode", tmp_path / "two.log", "--summary").out)
    assert "2 error frames (controller 1, protocol and bus error 1) in 0.125000 s from 0.200000;" in both
    assert "can0 120 Pressure 4" in both and "can1 120 Pressure 4" in both
    one = flat(cli("can", "decode", tmp_path / "two.log", "--summary", "--channel", "can1").out)
    assert "16 data frames, 0 remote, 0 error frames" in one
    assert "no such channel, only can0, can1" in cli("can", "decode", tmp_path / "two.log", "--channel", "can2").err
    assert "can1 Pressure" in flat(cli("can", "monitor", tmp_path / "two.log").out)
    assert "--channel is only for a log" in cli("can", "monitor", "--channel", "can1").err


def everything() -> Summary:
    """All twelve messages, one of them out of sequence, one that is not known, and an error frame."""
    known = [frame(spec, counter, t_ns=counter * 20_000_000) for spec in SPECS for counter in (0, 1, 8)]
    unknown = Frame(frame_id=0x18FEF100, data=bytes(64), is_extended=True)
    return summary_of(*known, unknown, can.Message(is_error_frame=True))


def picture(summary: Summary, width: int, now_s: float = 0.0) -> str:
    console = Console(file=StringIO(), width=width, force_terminal=True, color_system="standard", record=True)
    console.print(screen(summary, now_s, source="virtual x", matching="", width=width))
    return console.export_text(styles=True)


def test_it_is_whole_at_80_columns():
    lines = [one.rstrip() for one in Text.from_ansi(picture(everything(), 80)).plain.rstrip().splitlines()]
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    for spec in SPECS:
        assert f"\n{spec.name} " in text
    assert "PressureCounterValid" in text
    # Three frames, the last six ahead: one wrong sequence, six lost.
    (command,) = (one for one in lines if one.startswith("JetCommand "))
    assert command.split()[:2] == ["JetCommand", "130"]
    assert command.split()[-4:] == ["6", "1", "wrong", "sequence"]
    # Where no terminal is: twelve messages that each lost six and had one out of sequence, and an unknown one.
    said = "2 s: 37 data frames of 13 messages, 72 lost, 12 refused, 1 remote or error frames"
    assert line(everything(), 2.0) == said


def test_what_a_receiver_refuses_is_red_and_what_is_old_is_dim():
    once = frame(SPECS[0], 0)
    assert "\x1b[31mrepeated" in picture(summary_of(once, once), 100)
    fresh = picture(summary_of(once), 100)
    assert "\x1b[31m" not in fresh and "\x1b[2m" not in fresh
    assert "\x1b[2m" in picture(summary_of(once), 100, now_s=STALE_S + 0.1)
