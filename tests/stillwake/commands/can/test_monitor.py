"""`stillwake can monitor` on a virtual bus and on logs, and what is refused."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

from tests.stillwake.commands.can.bus_traffic import write
from tests.stillwake.commands.can.virtual_bus import VIRTUAL, flat, send_when_heard


def test_monitor_of_a_log_shows_its_end(cli: Callable[..., Any], tmp_path: Path) -> None:
    write(tmp_path / "a.asc", 20)
    got = cli("can", "monitor", "--log", tmp_path / "a.asc")
    assert got.code == 0, got.err
    # The last frame is 3.5 ms behind the last status: 0.00 s old by the log's clock, at 50 a second.
    assert "EcuStatus 140 0.00 50.0 0 0 OK" in flat(got.out)
    assert "Missed 19" in flat(got.out)
    assert "80 frames, 0 lost, 0 refused" in got.out
    only = cli("can", "monitor", "--log", tmp_path / "a.asc", "--filter", "flow", "--once").out
    assert "Flow 1.9 m2/s" in flat(only)
    assert "Missed" not in only


def test_monitor_of_a_bus_prints_lines_and_a_table(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> None:
    made = write(tmp_path / "a.log", 5)
    thread = threading.Thread(target=send_when_heard, args=(peer, made))
    thread.start()
    got = cli("can", "monitor", "--for", 1.5, *VIRTUAL)
    thread.join()
    assert got.code == 0, got.err
    assert "1 s: 20 data frames of 4 messages, 0 lost, 0 refused, 0 remote or error frames" in got.out
    assert "20 frames, 0 lost, 0 refused   virtual test-can" in got.out


def test_monitor_refuses_in_one_line(cli: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("empty.log").touch()
    for words, error in [
        (["--log", "missing.log"], "missing.log: there is no such file"),
        (["--log", "empty.log"], "empty.log: holds no CAN frame"),
        ([], "that bus exists within a run only"),
        (["--speed", "2"], "--speed: goes with --log"),
        (["--log", "empty.log", "--speed", "-1"], "--speed -1: must be a number above 0"),
        (["--for", "inf"], "--for inf: must be a number above 0"),
        (["--dbc", "missing.dbc"], "missing.dbc: No such file"),
        (["--set", "bus.interface=nonsense"], "nonsense"),
    ]:
        got = cli("can", "monitor", *words)
        assert got.code == 1, (words, error)
        assert error in got.err, (words, error)
        assert got.err.count("\n") == 1, (words, error)
