"""Periodic messages, and their worst-case response times on a CAN bus without errors.

The source is Davis, Burns, Bril and Lukkien, "Controller Area Network (CAN) schedulability analysis: refuted, revisited
and revised", Real-Time Systems 35 (2007), section 3. A frame cannot be interrupted, so a message waits for at most one
frame of lower priority (blocking, B), and for every frame of higher priority that is queued before the message is sent.
If all messages are queued at the same instant, the slowest frame of a message need not be the first frame after this
instant, so the analysis examines every frame in the busy period of the message's priority.

The analysis holds if each node always offers its most urgent frame and queues the frames of one message in order, no
frame is sent twice, and messages keep their periods and jitters. Phases do not matter.

With CAN FD the same equations hold: a node loses in the arbitration phase, which has the nominal bit rate, and then
waits for one whole frame. A frame of higher priority can still win if it is queued at most one nominal bit after the
bus became free; this time is the paper's tau_bit. The bits of the data phase are shorter; a longer tau_bit can only
increase the number of counted frames.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate, pairwise
from typing import Final, NamedTuple

from can_bridge.wire.frame import Frame, Priority, priority
from can_bridge.wire.frame_bits import worst_case_ns
from can_bridge.wire.message_specs import SPECS
from contract.config.vehicle import BusConfig

NS_PER_MS: Final = 10**6

OUR_IDS: Final = frozenset(spec.frame_id for spec in SPECS)
"""Identifiers of our messages in all message sets, used or not. No message of another node may have one of them."""


@dataclass(frozen=True, kw_only=True)
class PeriodicMessage:
    """A periodic message of a node.

    Attributes:
        period_ns: shortest time between two releases.
        offset_ns: time of the first release.
        jitter_ns: largest delay from a release until the frame is queued.
        deadline_ns: time after a release by which the frame has to arrive; 0 means the period.
    """

    name: str
    frame_id: int
    is_extended: bool = False
    is_fd: bool
    length: int
    period_ns: int
    offset_ns: int = 0
    jitter_ns: int = 0
    deadline_ns: int = 0

    @property
    def priority(self) -> Priority:
        return priority(self.frame(bytes(self.length)))

    def frame(self, data: bytes) -> Frame:
        """Return a frame of the message; `data` must have `length` bytes."""
        return Frame(frame_id=self.frame_id, data=data, is_fd=self.is_fd, is_extended=self.is_extended)

    def worst_ns(self, bus: BusConfig) -> int:
        """Return the longest time in ns for which a frame of the message occupies the bus."""
        return worst_case_ns(
            self.frame(bytes(self.length)), nominal_bitrate=bus.nominal_bitrate, data_bitrate=bus.data_bitrate
        )


LONGEST_BUSY_NS: Final = 60 * 10**9
"""Longest examined busy period in ns. After a longer one (near 100 % load), the response time counts as unbounded."""


class MessageTiming(NamedTuple):
    """A message's parameters in the analysis: the paper's C, T, D and J. `deadline_ns` is the longest permitted time
    from the release to the end of the frame."""

    frame_ns: int
    period_ns: int
    deadline_ns: int
    jitter_ns: int = 0


@dataclass(frozen=True, kw_only=True)
class Response:
    """The worst-case response of a message.

    Attributes:
        blocking_ns: time of the longest frame of lower priority, B.
        response_ns: longest time from the release to the end of the frame, including the intermission; None if
            unbounded.
    """

    blocking_ns: int
    response_ns: int | None
    deadline_ns: int

    @property
    def in_time(self) -> bool:
        return self.response_ns is not None and self.response_ns <= self.deadline_ns


def response_times(timings: Sequence[MessageTiming], *, bit_ns: int) -> list[Response]:
    """Return the response times of messages, highest priority first; `bit_ns` is the time of a bit, rounded up."""
    blocking = [0, *accumulate((one.frame_ns for one in reversed(timings[1:])), max)][::-1]
    higher: _Rhythms = {}
    responses = []
    for own, blocked in zip(timings, blocking, strict=False):
        responses.append(_response(own, higher, blocked, bit_ns))
        higher = _with(higher, own)
    return responses


def message_response_times(messages: Sequence[PeriodicMessage], bus: BusConfig) -> list[Response]:
    """Return the response times of all messages. Raises ValueError unless they are in strictly falling priority."""
    for one, other in pairwise(messages):
        if one.priority >= other.priority:
            raise ValueError(f"{one.name} before {other.name}: messages must be in strictly falling priority")
    timings = [
        MessageTiming(
            frame_ns=message.worst_ns(bus),
            period_ns=message.period_ns,
            deadline_ns=message.deadline_ns or message.period_ns,
            jitter_ns=message.jitter_ns,
        )
        for message in messages
    ]
    return response_times(timings, bit_ns=_ceil(10**9, bus.nominal_bitrate))


_Rhythms = dict[tuple[int, int], int]
"""Sum of the frame times in ns of all messages that share a period and a jitter, by period and jitter in ns. The
analysis needs only these sums: thousands of messages have only about a dozen different pairs of period and jitter."""


def _with(rhythms: _Rhythms, one: MessageTiming) -> _Rhythms:
    rhythm = one.period_ns, one.jitter_ns
    return {**rhythms, rhythm: rhythms.get(rhythm, 0) + one.frame_ns}


def _response(own: MessageTiming, higher: _Rhythms, blocking: int, bit_ns: int) -> Response:
    busy = _busy_ns(_with(higher, own), blocking)
    if busy is None:
        return Response(blocking_ns=blocking, response_ns=None, deadline_ns=own.deadline_ns)
    worst = 0
    # The search for a frame's start begins at the end of the previous frame, because the frames of a message are sent
    # in the order in which they were queued.
    queued = blocking
    for instance in range(_ceil(busy + own.jitter_ns, own.period_ns)):
        while True:
            waited = blocking + instance * own.frame_ns + _demand(higher, queued, bit_ns)
            if waited == queued:
                break
            queued = waited
        worst = max(worst, own.jitter_ns + queued - instance * own.period_ns + own.frame_ns)
        queued += own.frame_ns
    return Response(blocking_ns=blocking, response_ns=worst, deadline_ns=own.deadline_ns)


def _busy_ns(rhythms: _Rhythms, blocking: int) -> int | None:
    """Return the longest time in ns for which a blocking frame and these messages fill the bus; None if unbounded."""
    load = sum((Fraction(busy, period) for (period, _), busy in rhythms.items()), Fraction(0))
    # With a load of 1 the busy period ends only without blocking and jitter. With a smaller load it always ends.
    if load > 1 or (load == 1 and (blocking or any(jitter for _, jitter in rhythms))):
        return None
    busy = blocking + sum(rhythms.values())
    while busy <= LONGEST_BUSY_NS:
        longer = blocking + _demand(rhythms, busy, 0)
        if longer == busy:
            return busy
        busy = longer
    return None


def _demand(rhythms: _Rhythms, within_ns: int, bit_ns: int) -> int:
    """Return the largest total time in ns on the bus of all frames that can be queued within `within_ns`."""
    return sum(_ceil(within_ns + jitter + bit_ns, period) * busy for (period, jitter), busy in rhythms.items())


def _ceil(dividend: int, divisor: int) -> int:
    return -(-dividend // divisor)
