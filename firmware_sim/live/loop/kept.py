"""What the loop keeps of each of its latest periods: all that a saved run needs."""

import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from can_bridge.bus.simulated.medium import BusActivity
from can_bridge.wire.frame import Frame
from firmware_sim.runs.run_log import BusTotals, Row

_HEAD: Final = struct.Struct("<QIBB")
"""Time stamp, identifier, flags and bytes of a frame."""
_FD, _EXTENDED = 1, 2


@dataclass(frozen=True, kw_only=True)
class Counted:
    """As of the start of a period.

    Attributes:
        activity: of the bus.
        bus: totals of the loop's own frames.
        acted: how often what disturbs the run then has acted, by its serial number.
    """

    activity: BusActivity
    bus: BusTotals
    acted: Mapping[int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptPeriod:
    """One control period.

    Attributes:
        k: its number.
        requested: whether control was.
        before: what had been counted.
        planned_ns: what a step that planned took in virtual time; None without one.
        waits_ns: of the identifiers that were sent, the longest time from hand-over to the attempt that succeeded.
        frames: all on the bus, packed.
    """

    k: int
    row: Row
    requested: bool
    before: Counted
    planned_ns: int | None
    waits_ns: Mapping[int, int]
    frames: bytes


def packed(frames: Iterable[Frame]) -> bytes:
    """A tenth of what they take as objects: of a node that babbles there are a quarter of a million in a minute."""
    return b"".join(
        _HEAD.pack(
            frame.timestamp_ns,
            frame.frame_id,
            _FD * frame.is_fd | _EXTENDED * frame.is_extended,
            len(frame.data),
        )
        + frame.data
        for frame in frames
    )


def unpacked(raw: bytes) -> Iterator[Frame]:
    """What `packed` made."""
    at = 0
    while at < len(raw):
        timestamp_ns, frame_id, flags, length = _HEAD.unpack_from(raw, at)
        at += _HEAD.size + length
        yield Frame(
            frame_id=frame_id,
            data=raw[at - length : at],
            timestamp_ns=timestamp_ns,
            is_fd=bool(flags & _FD),
            is_extended=bool(flags & _EXTENDED),
        )
