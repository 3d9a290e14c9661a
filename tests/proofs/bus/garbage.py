"""What no node should put on a bus: datagrams, serial lines and messages, each from a generator of random numbers."""

from random import Random
from typing import Any, Final

import can
import msgpack  # type: ignore[import-untyped]  # ships none

_BAD_LINES: Final = (
    *(b"tzzz1AA\r", b"t\r", b"t12\r", b"b12\xff\xfe\r", b"t1231A\r", b"t1238AA\r", b"r1208\r", b"T000001201AA\r"),
    b"\a",
)
_FIELDS: Final = (
    *("arbitration_id", "data", "dlc", "is_extended_id", "is_remote_frame", "is_error_frame", "is_fd"),
    *("bitrate_switch", "error_state_indicator", "channel", "surprise"),
)


def odd_value(rng: Random) -> Any:
    """A value of any type that a datagram can hold."""
    numbers = (rng.randrange(0x800), rng.randrange(-(2**63), 2**64), rng.uniform(-1e9, 1e9), float("nan"))
    others: tuple[Any, ...] = (
        None,
        rng.random() < 0.5,
        "x" * rng.randrange(5),
        rng.randbytes(rng.randrange(70)),
        [1, 2],
        {},
    )
    return rng.choice((*numbers, *others))


def any_datagram(rng: Random, sound: bytes) -> bytes:
    """Anything: noise, a sound one with damaged bytes, or one with damaged values."""
    kind = rng.randrange(4)
    if kind == 0:
        return rng.randbytes(rng.randrange(200))
    if kind == 1:
        return damaged(rng, sound)
    fields = msgpack.unpackb(sound)
    for _ in range(rng.randrange(1, 3)):
        fields[rng.choice(_FIELDS)] = odd_value(rng)
    if kind == 2:
        fields.pop(rng.choice(list(fields)))
    packed: bytes = msgpack.packb(fields)
    return packed


def any_line(rng: Random, sound: bytes) -> bytes:
    """Anything, mostly with an end: noise, a damaged line, a line of another kind."""
    kind = rng.randrange(4)
    if kind == 0:
        return rng.randbytes(rng.randrange(40)) + b"\r"
    if kind == 1:
        return damaged(rng, sound)
    if kind == 2:
        return rng.choice(_BAD_LINES)
    digits = "".join(rng.choices("0123456789ABCDEF", k=rng.randrange(150)))
    return (rng.choice("tTdDbBrRxzVN") + digits).encode() + rng.choice((b"\r", b"\a", b""))


def any_message(rng: Random) -> can.Message:
    """A message of python-can's with any flags, and now and then a value of another type."""
    fields: dict[str, Any] = {
        "arbitration_id": rng.randrange(0x800) if rng.random() < 0.8 else rng.randrange(2**32),
        "is_extended_id": rng.random() < 0.2,
        "is_remote_frame": rng.random() < 0.1,
        "is_error_frame": rng.random() < 0.1,
        "is_fd": rng.random() < 0.5,
        "data": rng.randbytes(rng.choice((0, 7, 8, 8, 12, 16, 24, 32, 64, rng.randrange(70)))),
        "timestamp": rng.choice((0.0, 1.5, -1.0, float("nan"), float("inf"), 1e300)),
    }
    if rng.random() < 0.3:
        fields["dlc"] = rng.randrange(70)
    if rng.random() < 0.1:
        fields[rng.choice(("arbitration_id", "is_fd", "dlc", "timestamp"))] = odd_value(rng)
    return can.Message(**fields)


def damaged(rng: Random, content: bytes) -> bytes:
    """The content with some bytes changed, left out, doubled or put in."""
    changed = bytearray(content)
    for _ in range(rng.randrange(1, 4)):
        place, length = rng.randrange(len(changed) + 1), rng.randrange(1, 5)
        cut, new = rng.choice(
            ((1, rng.randbytes(1)), (length, b""), (0, changed[place:][:length]), (0, rng.randbytes(length)))
        )
        changed[place : place + cut] = new
    return bytes(changed)
