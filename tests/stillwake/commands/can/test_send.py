"""`stillwake can send` and `keygen --secret`: frames on a virtual bus, and a key that is written once."""

import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

from can_bridge.e2e.profiles import PROFILE_5
from tests.stillwake.commands.can.virtual_bus import VIRTUAL, taken


def test_send_puts_protected_frames_on_the_bus(cli: Callable[..., Any], peer: can.BusABC) -> None:
    got = cli("can", "send", "JetCommand", "Flow=1.5", "Mode=CONTROL", "--count", 3, "--counter", 254, *VIRTUAL)
    assert (got.code, got.out) == (0, "sent 3 frames\n")
    frames = taken(peer)
    assert [(one.arbitration_id, one.is_fd, one.bitrate_switch) for one in frames] == [(0x130, True, True)] * 3
    assert [one.data[2] for one in frames] == [254, 255, 0]
    assert all(PROFILE_5.check(bytes(one.data), data_id=0x5702) for one in frames)


def cmac(key: bytes, message: bytes) -> bytes:
    computing = CMAC(AES(key))
    computing.update(message)
    return computing.finalize()


def test_send_signs_messages_of_the_secured_set_with_a_key_that_is_written_once(
    cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path
) -> None:
    """Against the layout in the DBC's comments: CMAC over data ID, bytes in front of the freshness, and freshness."""
    key = tmp_path / "bus.key"
    made = cli("keygen", "--secret", key)
    assert f"--set bus.key={key}" in made.out and f"--access {key}" in made.out
    content = key.read_text()
    assert stat.S_IMODE(key.stat().st_mode) == 0o600 and content.strip() not in made.out
    again = cli("keygen", "--secret", key)
    assert (again.code, again.err) == (1, f"error: {key}: exists already; a key is never overwritten\n")
    assert key.read_text() == content
    words = ("PressureSecured", "Pressure0=-12.5", "Valid0=1", "--count", 2, "--trip", 7, "--set", f"bus.key={key}")
    got = cli("can", "send", *words, *VIRTUAL)
    assert (got.code, got.out) == (0, "sent 2 frames\n")
    frames = [bytes(one.data) for one in taken(peer)]
    assert [int.from_bytes(data[16:24], "big") for data in frames] == [7 << 32, 7 << 32 | 1]
    secret = bytes.fromhex(content.strip())
    assert [cmac(secret, (0x5704).to_bytes(2, "big") + data[:24])[:8] for data in frames] == [x[24:] for x in frames]
    assert [PROFILE_5.check(data[:16], data_id=0x5704) for data in frames] == [True, True]
