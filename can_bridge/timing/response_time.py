"""Worst-case response times of periodic messages on a CAN bus without errors.

Davis, Burns, Bril and Lukkien, "Controller Area Network (CAN) schedulability analysis: refuted, revisited and revised",
Real-Time Systems 35 (2007), section 3: a frame cannot be interrupted, so a message waits for one frame of lower
priority at most (blocking, B), and for every frame of higher priority that comes before its own turn. Its worst frame
need not be the first after all messages came at once: every frame within the priority level's busy period is looked at.

It holds where each node always offers its most urgent frame and queues the frames of one message in turn, no frame is
sent twice, and messages keep to their periods and jitters; phases do not matter.

With CAN FD the same equations hold: whoever loses does so in the arbitration phase, which is at the nominal bit rate,
and is out for one whole frame. A frame of higher priority can still win if it is queued at most one nominal bit after
the bus got free: the tau_bit of the paper. The bits of the data phase are shorter, and a longer tau_bit can only count
more frames.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate, pairwise
from typing import Final

from can_bridge.timing.periodic_message import PeriodicMessage
from contract.config.vehicle import BusConfig

LONGEST_BUSY_NS: Final = 60 * 10**9
"""A priority level that can be busy for longer counts as without bound; only loads just below 100 % come there."""


@dataclass(frozen=True, kw_only=True)
class MessageTiming:
    """A message as the analysis sees it: the paper's C, T, D and J.

    Attributes:
        frame_ns: the frame on the bus at worst, C.
        period_ns: T.
        deadline_ns: after the release, D.
        jitter_ns: most by which a frame is queued after its release, J.
    """

    frame_ns: int
    period_ns: int
    deadline_ns: int
    jitter_ns: int = 0


@dataclass(frozen=True, kw_only=True)
class Response:
    """What can happen to a message at worst.

    Attributes:
        blocking_ns: the longest frame of lower priority, B.
        response_ns: from release to the end of the frame, the intermission included; None without bound.
        instance: which frame of the busy period takes so long; 0 is the first.
        deadline_ns: after the release.
    """

    blocking_ns: int
    response_ns: int | None
    instance: int
    deadline_ns: int

    @property
    def in_time(self) -> bool:
        """Whether no frame can miss its deadline."""
        return self.response_ns is not None and self.response_ns <= self.deadline_ns


def response_times(timings: Sequence[MessageTiming], *, bit_ns: int) -> list[Response]:
    """Response times of all messages.

    Args:
        timings: the highest priority first.
        bit_ns: one bit at the nominal rate, rounded up.
    """
    blocking = [0, *accumulate((one.frame_ns for one in reversed(timings[1:])), max)][::-1]
    higher: _Rhythms = {}
    responses = []
    for own, blocked in zip(timings, blocking, strict=False):
        responses.append(_response(own, higher, blocked, bit_ns))
        higher = _with(higher, own)
    return responses


def message_response_times(messages: Sequence[PeriodicMessage], bus: BusConfig) -> list[Response]:
    """Response times of all messages, in the order given, which is that of their priorities. Raises ValueError if the
    messages are not in falling priority, each with its own."""
    for one, other in pairwise(messages):
        if one.priority >= other.priority:
            raise ValueError(f"{one.name} before {other.name}: messages must be in falling priority, each with its own")
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
"""Bus time that messages take each time they come, by period and jitter: the analysis uses no more of them, and
thousands of messages have a dozen rhythms."""


def _with(rhythms: _Rhythms, one: MessageTiming) -> _Rhythms:
    rhythm = one.period_ns, one.jitter_ns
    return {**rhythms, rhythm: rhythms.get(rhythm, 0) + one.frame_ns}


def _response(own: MessageTiming, higher: _Rhythms, blocking: int, bit_ns: int) -> Response:
    busy = _busy_ns(_with(higher, own), blocking)
    if busy is None:
        return Response(blocking_ns=blocking, response_ns=None, instance=0, deadline_ns=own.deadline_ns)
    worst, worst_instance = 0, 0
    # Of the first frame, then of those after it: none waits less than the one before and its transmission.
    queued = blocking
    for instance in range(_ceil(busy + own.jitter_ns, own.period_ns)):
        while True:
            waited = blocking + instance * own.frame_ns + _demand(higher, queued, bit_ns)
            if waited == queued:
                break
            queued = waited
        response = own.jitter_ns + queued - instance * own.period_ns + own.frame_ns
        if response > worst:
            worst, worst_instance = response, instance
        queued += own.frame_ns
    return Response(blocking_ns=blocking, response_ns=worst, instance=worst_instance, deadline_ns=own.deadline_ns)


def _busy_ns(rhythms: _Rhythms, blocking: int) -> int | None:
    """The longest time for which the bus can be busy with these messages after a blocking frame; None without bound."""
    load = sum((Fraction(busy, period) for (period, _), busy in rhythms.items()), Fraction(0))
    # At a load of 1 it ends only if nothing adds to it; below, always, but near 1 late.
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
    """Bus time of all frames that can be queued within a time, at worst."""
    return sum(_ceil(within_ns + jitter + bit_ns, period) * busy for (period, jitter), busy in rhythms.items())


def _ceil(dividend: int, divisor: int) -> int:
    return -(-dividend // divisor)
