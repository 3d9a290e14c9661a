"""What no node should put on a bus: datagrams and serial lines that no receiver takes for a frame."""

from random import Random
from typing import Final

import msgpack  # type: ignore[import-untyped]  # ships none

_LINES: Final = (
    b"tzzz1AA\r",
    b"t\r",
    b"b12\xff\xfe\r",
    b"t1231A\r",
    b"t1238AA\r",
    b"r1208\r",
    b"T000001201AA\r",
    b"\a",
)


def garbage_datagram(rng: Random) -> bytes:
    """One datagram without a frame."""
    # 0xC1 is the one byte that msgpack never uses.
    return rng.choice((b"", b"garbage", b"\xc1" + rng.randbytes(rng.randrange(80)), msgpack.packb({"data": 2**30})))


def garbage_line(rng: Random) -> bytes:
    """One line with its end and without a frame."""
    return rng.choice(_LINES)
