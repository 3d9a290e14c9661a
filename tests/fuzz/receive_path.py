"""One input for the whole receive path: the bytes say which backend hears what.

Hypothesis gives it inputs in tests/can_bridge/bus/test_receive_path.py, atheris by hand: see tests/fuzz/__main__.py.
"""

import struct

import can

from can_bridge.bus.backends.slcan import LINE_LIMIT
from tests.proofs.bus.receive_path import ReceivePath

_MESSAGE = struct.Struct("<IBdB")
"""Identifier, flags, time, length that the message claims."""

PATH = ReceivePath()
"""One for all inputs: what an earlier one left behind must not harm a later one either."""


def follow(content: bytes) -> None:
    """Feed one input: the first byte chooses the backend, the rest is what it hears.

    Raises:
        AssertionError: if a reception was neither accepted nor refused for a reason.
    """
    kind, rest = content[:1], content[1:]
    received = sum(bus.received for bus in PATH.buses)
    if kind < b"\x55":
        datagrams = rest.split(b"\xc1\xc1")  # 0xC1 has no meaning in msgpack
        PATH.datagrams(datagrams)
        expected = len(datagrams)
    elif kind < b"\xaa":
        PATH.lines(rest[:LINE_LIMIT])
        # Whatever the line was cut off in, an end brings it back to its begin.
        PATH.lines(b"\r")
        ends = (rest[:LINE_LIMIT] + b"\r").replace(b"\a", b"\a\0").replace(b"\r", b"\r\0").split(b"\0")
        expected = sum(line not in (b"\r", b"z\r", b"Z\r") for line in ends[:-1]) if b"\0" not in rest else -1
    else:
        PATH.messages([_message(rest)])
        expected = 1
    found = sum(bus.received for bus in PATH.buses) - received
    if expected not in (found, -1):
        raise AssertionError(f"{expected} receptions went in, {found} were counted")


def _message(content: bytes) -> can.Message:
    frame_id, flags, time, length = _MESSAGE.unpack(content[: _MESSAGE.size].ljust(_MESSAGE.size, b"\0"))
    return can.Message(
        arbitration_id=frame_id,
        is_extended_id=bool(flags & 1),
        is_remote_frame=bool(flags & 2),
        is_error_frame=bool(flags & 4),
        is_fd=bool(flags & 8),
        dlc=length if flags & 16 else None,
        timestamp=time,
        data=content[_MESSAGE.size :],
    )
