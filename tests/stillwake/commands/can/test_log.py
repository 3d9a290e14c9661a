"""`stillwake can record|replay` on a virtual bus, and what is refused."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

from can_bridge.logs.log_reader import read_messages
from tests.stillwake.commands.can.bus_traffic import PER_PERIOD, write
from tests.stillwake.commands.can.virtual_bus import VIRTUAL, send_when_heard, taken


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf", ".trc"])
def test_record_writes_every_kind_of_frame(
    cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"a{suffix}"
    sent = [
        can.Message(timestamp=1.0, arbitration_id=0x123, is_extended_id=False, data=b"\1\2"),
        can.Message(timestamp=1.1, arbitration_id=0x1ABCDEF0, is_fd=True, bitrate_switch=True, data=bytes(64)),
        can.Message(timestamp=1.2, arbitration_id=0x7FF, is_extended_id=False, is_remote_frame=True),
        can.Message(timestamp=1.3, is_error_frame=True),
        can.Message(timestamp=1.4, arbitration_id=0x120, is_extended_id=False, is_fd=True, data=bytes(16)),
    ]
    thread = threading.Thread(target=send_when_heard, args=(peer, sent))
    thread.start()
    got = cli("can", "record", path, "--frames", len(sent), *VIRTUAL)
    thread.join()
    assert got.code == 0, got.err
    assert f"wrote {path}: 5 frames, {path.stat().st_size} bytes" in got.out
    assert ("note: .trc does not keep error frames: 1" in got.out) is (suffix == ".trc")
    kept = [one for one in sent if suffix != ".trc" or not one.is_error_frame]
    read = list(read_messages(path))
    assert [(one.is_error_frame, one.is_remote_frame, bytes(one.data)) for one in read] == [
        (one.is_error_frame, one.is_remote_frame, bytes(one.data)) for one in kept
    ]
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


def test_record_ends_in_time_and_never_replaces_unasked(cli: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    assert cli("can", "record", path, "--for", 0.1, *VIRTUAL).code == 0
    assert path.read_bytes() == b""
    path.write_text("mine")
    got = cli("can", "record", path, "--for", 0.1, *VIRTUAL)
    assert got.code == 1
    assert "--overwrite" in got.err
    assert path.read_text() == "mine"
    assert cli("can", "record", path, "--for", 0.1, "--overwrite", *VIRTUAL).code == 0
    assert path.read_bytes() == b""


def test_a_bus_that_fails_leaves_what_was_recorded(
    cli: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from can.interfaces.virtual import VirtualBus

    came: list[can.Message | OSError] = [can.Message(timestamp=1.0, arbitration_id=1, data=b"x"), OSError("unplugged")]

    def recv(self: object, timeout: float | None = None) -> can.Message:
        one = came.pop(0)
        if isinstance(one, OSError):
            raise one
        return one

    monkeypatch.setattr(VirtualBus, "recv", recv)
    path = tmp_path / "a.blf"
    got = cli("can", "record", path, *VIRTUAL)
    assert got.code == 1
    assert got.err == f"error: CAN bus failed: unplugged; {path} has the 1 frames until then\n"
    assert len(list(read_messages(path))) == 1


def test_record_refuses_other_endings(cli: Callable[..., Any], tmp_path: Path) -> None:
    for name in ["a.csv", "a", "a.mf4.txt"]:
        got = cli("can", "record", tmp_path / name, *VIRTUAL)
        assert got.code == 1, name
        assert "a log must end in .log, .asc, .blf, .trc, .mf4" in got.err, name
        assert list(tmp_path.iterdir()) == [], name


def test_replay_sends_the_log_and_says_how_late(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> None:
    made = write(tmp_path / "a.blf", 10)
    got = cli("can", "replay", tmp_path / "a.blf", "--speed", 2, *VIRTUAL)
    assert got.code == 0, got.err
    frames = taken(peer)
    assert [(one.arbitration_id, bytes(one.data)) for one in frames] == [
        (one.arbitration_id, bytes(one.data)) for one in made
    ]
    assert f"sent {len(made)} frames" in got.out
    assert "later than recorded: p50 " in got.out


def test_replay_of_some_identifiers(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> None:
    write(tmp_path / "a.log", 5)
    got = cli("can", "replay", tmp_path / "a.log", "--only", "130, 18FEF100", *VIRTUAL)
    assert {one.arbitration_id for one in taken(peer)} == {0x130, 0x18FEF100}
    assert "sent 10 frames" in got.out
    assert "; 10 left out" in got.out


def test_replay_in_a_loop_goes_on_until_stopped(
    cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from can_bridge.tools.raw_bus import RawBus

    write(tmp_path / "a.log", 2)
    send = RawBus.send_message
    stop = []

    def counted(self: RawBus, message: can.Message, *, timeout_s: float = 0.1) -> None:
        send(self, message, timeout_s=timeout_s)
        stop.append(message)

    monkeypatch.setattr(RawBus, "send_message", counted)
    monkeypatch.setattr(
        "stillwake.commands.can.log.until_stopped", lambda: _stops_when(lambda: len(stop) >= 3 * 2 * PER_PERIOD)
    )
    got = cli("can", "replay", tmp_path / "a.log", "--loop", "--speed", 10, *VIRTUAL)
    assert got.code == 0, got.err
    assert len(taken(peer)) == 3 * 2 * PER_PERIOD
    assert ", round 3" in got.out


class _stops_when:  # noqa: N801  (stands for a function)
    def __init__(self, is_stopped: Callable[[], bool]) -> None:
        self._is_stopped = is_stopped

    def __enter__(self) -> Callable[[], bool]:
        return self._is_stopped

    def __exit__(self, *_: object) -> None: ...


def test_replay_refuses_before_anything_is_sent(
    cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("good.log"), 1)
    write(Path("cut.blf"), 100)
    Path("cut.blf").write_bytes(Path("cut.blf").read_bytes()[:-100])
    Path("empty.log").touch()
    Path("back.log").write_text("(2.0) can0 001#\n(1.0) can0 001#\n")
    for words, error in [
        (["missing.log"], "missing.log: there is no such file"),
        (["empty.log"], "empty.log: holds no CAN frame"),
        (["back.log"], "back.log: time goes back at frame 2 (001), from 2.000000 to 1.000000 s"),
        (["cut.blf"], "cut.blf: "),
        (["good.log", "--only", "zz"], "--only zz: must be identifiers in hexadecimal"),
        (["good.log", "--only", "7ff"], "holds no CAN frame to send among its 4"),
        (["good.log", "--speed", "0"], "--speed 0: must be a number above 0"),
        (["good.log", "--speed", "1e-9"], "the replay would take"),
        (["good.txt"], "a log must end in"),
    ]:
        got = cli("can", "replay", *words, *VIRTUAL)
        assert got.code == 1, (words, error)
        assert error in got.err, (words, error)
        assert got.err.count("\n") == 1, (words, error)
        assert taken(peer) == [], (words, error)
