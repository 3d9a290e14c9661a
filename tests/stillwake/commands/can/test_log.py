"""`stillwake can record` and `replay` on a virtual bus."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import pytest

from can_bridge.logs.log_reader import read_messages
from tests.stillwake.commands.can.virtual_bus import PER_PERIOD, VIRTUAL, send_when_heard, taken, write


def test_record_writes_every_kind_of_frame(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> None:
    sent = [
        can.Message(timestamp=1.0, arbitration_id=0x123, is_extended_id=False, data=b"\1\2"),
        can.Message(timestamp=1.1, arbitration_id=0x1ABCDEF0, is_fd=True, bitrate_switch=True, data=bytes(64)),
        can.Message(timestamp=1.2, arbitration_id=0x7FF, is_extended_id=False, is_remote_frame=True),
        can.Message(timestamp=1.3, is_error_frame=True),
    ]
    for suffix in (".log", ".trc"):
        path = tmp_path / f"a{suffix}"
        thread = threading.Thread(target=send_when_heard, args=(peer, sent))
        thread.start()
        recorded = cli("can", "record", path, "--frames", len(sent), *VIRTUAL)
        thread.join()
        assert recorded.code == 0, recorded.err
        assert f"wrote {path}: 4 frames, {path.stat().st_size} bytes" in recorded.out
        assert ("note: .trc does not keep error frames: 1" in recorded.out) is (suffix == ".trc")
        kept = sent if suffix != ".trc" else sent[:-1]
        assert [(one.is_error_frame, one.is_remote_frame, bytes(one.data)) for one in read_messages(path)] == [
            (one.is_error_frame, one.is_remote_frame, bytes(one.data)) for one in kept
        ]


def test_record_ends_in_time_and_replaces_what_it_may(cli: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text("mine")
    assert cli("can", "record", path, "--for", 0.1, "--overwrite", *VIRTUAL).code == 0
    assert path.read_bytes() == b""


def test_a_bus_that_fails_leaves_what_was_recorded(
    cli: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    came = iter([can.Message(timestamp=1.0, arbitration_id=1, data=b"x")])

    def recv(self: object, timeout: float | None = None) -> can.Message:
        for one in came:
            return one
        raise OSError("unplugged")

    monkeypatch.setattr("can.interfaces.virtual.VirtualBus.recv", recv)
    path = tmp_path / "a.blf"
    recorded = cli("can", "record", path, *VIRTUAL)
    assert recorded.code == 1
    assert recorded.err == f"error: CAN bus failed: unplugged; {path} has the 1 frames until then\n"
    assert len(list(read_messages(path))) == 1


def test_replay_sends_the_log_or_some_of_it_and_reports_how_late(
    cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path
) -> None:
    made = write(tmp_path / "a.blf", 10)
    replayed = cli("can", "replay", tmp_path / "a.blf", "--speed", 2, *VIRTUAL)
    assert replayed.code == 0, replayed.err
    sent = [(one.arbitration_id, bytes(one.data)) for one in taken(peer)]
    assert sent == [(one.arbitration_id, bytes(one.data)) for one in made]
    assert f"sent {len(made)} frames" in replayed.out
    assert "later than recorded: p50 " in replayed.out
    some = cli("can", "replay", tmp_path / "a.blf", "--only", "130, 18FEF100", "--speed", 10, *VIRTUAL)
    assert {one.arbitration_id for one in taken(peer)} == {0x130, 0x18FEF100}
    assert "sent 20 frames" in some.out
    assert "; 20 left out" in some.out


def test_replay_in_a_loop_goes_on_until_stopped(
    cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[can.Message] = []

    @contextmanager
    def until_three_rounds() -> Iterator[Callable[[], bool]]:
        def are_over() -> bool:
            sent.extend(taken(peer))
            return len(sent) >= 3 * 2 * PER_PERIOD

        yield are_over

    write(tmp_path / "a.log", 2)
    monkeypatch.setattr("stillwake.commands.can.log.until_stopped", until_three_rounds)
    replayed = cli("can", "replay", tmp_path / "a.log", "--loop", "--speed", 10, *VIRTUAL)
    assert replayed.code == 0, replayed.err
    assert len(sent) == 3 * 2 * PER_PERIOD
    assert ", round 3" in replayed.out
