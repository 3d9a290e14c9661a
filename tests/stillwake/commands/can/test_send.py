"""`stillwake can send`: frames on a virtual bus, and what is refused."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

from can_bridge.e2e import profile5
from tests.stillwake.commands.can.virtual_bus import VIRTUAL, taken


def test_send_puts_protected_frames_on_the_bus(cli: Callable[..., Any], peer: can.BusABC) -> None:
    got = cli("can", "send", "JetCommand", "Flow=1.5", "Mode=CONTROL", "--count", 3, "--counter", 254, *VIRTUAL)
    assert (got.code, got.out) == (0, "sent 3 frames\n")
    frames = taken(peer)
    assert [(one.arbitration_id, one.is_fd, one.bitrate_switch) for one in frames] == [(0x130, True, True)] * 3
    assert [one.data[2] for one in frames] == [254, 255, 0]
    assert all(profile5.check(bytes(one.data), data_id=0x5702) for one in frames)


def cmac(key: bytes, message: bytes) -> bytes:
    computing = CMAC(AES(key))
    computing.update(message)
    return computing.finalize()


def test_send_signs_messages_of_the_secured_set(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> None:
    """Against the layout in the DBC's comments: CMAC over data ID, bytes in front of the freshness, and freshness."""
    key = tmp_path / "bus.key"
    assert cli("can", "keygen", key).code == 0
    words = ("PressureSecured", "Pressure0=-12.5", "Valid0=1", "--count", 2, "--trip", 7, "--set", f"bus.key={key}")
    got = cli("can", "send", *words, *VIRTUAL)
    assert (got.code, got.out) == (0, "sent 2 frames\n")
    frames = [bytes(one.data) for one in taken(peer)]
    assert [int.from_bytes(data[16:24], "big") for data in frames] == [7 << 32, 7 << 32 | 1]
    secret = bytes.fromhex(key.read_text().strip())
    assert [cmac(secret, (0x5704).to_bytes(2, "big") + data[:24])[:8] for data in frames] == [x[24:] for x in frames]
    assert [profile5.check(data[:16], data_id=0x5704) for data in frames] == [True, True]


def test_send_raw_frames_of_every_kind(cli: Callable[..., Any], peer: can.BusABC) -> None:
    words = ("123#1122", "1ABCDEF0##1AABBCC", "7FF#R4")
    got = cli("can", "send", *(word for one in words for word in ("--raw", one)), "--count", 2, *VIRTUAL)
    assert (got.code, got.out) == (0, "sent 6 frames\n")
    frames = taken(peer)
    assert [(one.arbitration_id, one.is_extended_id, one.is_remote_frame, one.is_fd) for one in frames[:3]] == [
        (0x123, False, False, False),
        (0x1ABCDEF0, True, False, True),
        (0x7FF, False, True, False),
    ]
    assert len(frames) == 6


def test_send_refuses_in_one_line(cli: Callable[..., Any], peer: can.BusABC) -> None:
    for words, error in [
        (["Pressure", "Pressure0=1e9"], "must be in -3276.8..3276.7"),
        (["Pressures"], "is none of Pressure, "),
        ([], "name a message and its values, or give --raw"),
        (["Pressure", "--raw", "123#"], "one of the two"),
        (["--raw", "12#"], "must be ID#DATA"),
        (["PressureSecured"], "name its key with --set bus.key=FILE"),
        (["PressureSecured", "--set", "bus.key=key.bin"], "name its power cycle with --trip"),
        (["PressureSecured", "--trip", "2", "--set", "bus.key=no.bin"], "no.bin: cannot read the key"),
        (["Pressure", "--trip", "2"], "Pressure has no freshness value"),
        (["--raw", "123#", "--trip", "2"], "--trip: goes with a message of the secured set"),
        (["Pressure", "--set", "bus.key=key.bin"], "is sent without authentication"),
        (["PressureClassic", "--counter", "16"], "--counter 16: must be in 0..15 for PressureClassic"),
        (["Pressure", "--period", "nan"], "--period nan: must be a number above 0"),
        (["Pressure", "--set", "bus.interface=simulated"], "that bus exists within a run only"),
        (["Pressure", "--set", "bus.interface=nonsense"], "nonsense"),
        (["Pressure", "--set", "ecu.delay_steps=1"], "`can send` does not use it"),
    ]:
        got = cli("can", "send", *VIRTUAL, *words)
        assert got.code == 1, (words, error)
        assert error in got.err, (words, error)
        assert got.err.count("\n") == 1, (words, error)
        assert taken(peer) == [], (words, error)
