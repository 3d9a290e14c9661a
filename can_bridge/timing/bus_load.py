"""The load of a bus, and worst-case response times of its messages if there are no errors.

docs/explanation/simulated-bus.md states the assumptions, and the source, whose section 3 has the equations. A frame
cannot be interrupted, so a message waits for at most one frame of lower priority (blocking, B), and for every frame of
higher priority that is queued before the message is sent. If all messages are queued at the same instant, the slowest
frame of a message need not be the first frame after this instant, so the analysis examines every frame in the busy
period of the message's priority.

With CAN FD the same equations hold: a node loses in the arbitration phase, which has the nominal bit rate, and then
waits for one whole frame. A frame of higher priority can still win if it is queued at most one nominal bit after the
bus became free; this time is tau_bit in the source. The bits of the data phase are shorter. The nominal tau_bit is used
for them too, because a longer tau_bit can only increase the number of counted frames.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import accumulate
from random import Random
from typing import Final, NamedTuple

from can_bridge.timing.background import NS_PER_MS, PeriodicMessage, background
from can_bridge.wire.frame_bits import frame_ns
from can_bridge.wire.message_sets import message_set
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError

LONGEST_BUSY_NS: Final = 60 * 10**9
"""Longest examined busy period in ns. If it is longer (near 100 % load), the response time counts as unbounded."""


class MessageTiming(NamedTuple):
    """A message's C, T, D and J of the source. `deadline_ns` is the longest permitted time to the end of the frame."""

    frame_ns: int
    period_ns: int
    deadline_ns: int
    jitter_ns: int = 0


@dataclass(frozen=True, kw_only=True)
class Response:
    """The worst-case response of a message.

    Attributes:
        blocking_ns: time of the longest frame of lower priority, B.
        response_ns: longest time from release to end of frame, including the intermission; None if unbounded.
    """

    blocking_ns: int
    response_ns: int | None
    deadline_ns: int

    @property
    def in_time(self) -> bool:
        return self.response_ns is not None and self.response_ns <= self.deadline_ns


def response_times(timings: Sequence[MessageTiming], *, bit_ns: int) -> list[Response]:
    """Return the response times of messages, highest priority first; `bit_ns` is a nominal bit's time, rounded up."""
    blocking = [0, *accumulate((one.frame_ns for one in reversed(timings[1:])), max)][::-1]
    higher: _Rhythms = {}
    responses = []
    for own, blocked in zip(timings, blocking, strict=False):
        responses.append(_response(own, higher, blocked, bit_ns))
        higher = _with(higher, own)
    return responses


def message_response_times(messages: Sequence[PeriodicMessage], bus: BusConfig) -> list[Response]:
    """Return the response times of messages, highest priority first."""
    timings = [
        MessageTiming(one.worst_ns(bus), one.period_ns, one.deadline_ns or one.period_ns, one.jitter_ns)
        for one in messages
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
    # The search for a frame's start begins at the previous frame's end: a message's frames are sent in their order.
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
    """Return the longest time in ns for which the frames that can be queued within `within_ns` occupy the bus."""
    return sum(_ceil(within_ns + jitter + bit_ns, period) * busy for (period, jitter), busy in rhythms.items())


def _ceil(dividend: int, divisor: int) -> int:
    return -(-dividend // divisor)


_CONTENTS: Final = 16
"""Number of frames whose times are averaged; the standard error of the mean is below half a per cent."""


@dataclass(frozen=True, kw_only=True)
class MessageLoad:
    """The load of one message on the bus.

    Attributes:
        ours: whether the message belongs to the control loop, not to the background.
        worst_ns, mean_ns: longest and mean time of a frame with intermission; the mean is over random contents.
        response: worst-case response time. For the ECU's messages it begins one compute time of the ECU after the
            pressures were sampled, so it is the time that the bus adds to the age of the pressures.
    """

    message: PeriodicMessage
    ours: bool
    worst_ns: int
    mean_ns: float
    response: Response


@dataclass(frozen=True, kw_only=True)
class BusLoad:
    """The load of all messages of a bus, highest priority first.

    Attributes:
        mean, worst: shares of time for which the bus is occupied, with random contents and with the longest frames.
        left_out: see `BackgroundTraffic`.
    """

    messages: tuple[MessageLoad, ...]
    mean: float
    worst: float
    left_out: tuple[str, ...]

    @property
    def late(self) -> tuple[MessageLoad, ...]:
        return tuple(one for one in self.messages if not one.response.in_time)


def bus_load(config: Config) -> BusLoad:
    """Return loads and worst-case response times. Raises the errors of `background` and `loop_messages`."""
    bus = config.bus
    others = background(bus)
    ours = loop_messages(config, others.messages)
    everyone = _by_priority((*ours, *others.messages))
    loads = tuple(
        MessageLoad(message=one, ours=one in ours, worst_ns=one.worst_ns(bus), mean_ns=mean_ns(one, bus), response=time)
        for one, time in zip(everyone, message_response_times(everyone, bus), strict=True)
    )
    return BusLoad(
        messages=loads,
        mean=sum(one.mean_ns / one.message.period_ns for one in loads),
        worst=sum(one.worst_ns / one.message.period_ns for one in loads),
        left_out=others.left_out,
    )


def loop_messages(config: Config, others: Sequence[PeriodicMessage] = ()) -> tuple[PeriodicMessage, ...]:
    """Return the four messages of the control loop, highest priority first. The ECU sends its messages in answer to a
    pressure frame, so their jitter is the worst-case response time of the pressures. The command has to arrive within
    the control period minus the ECU's compute time; raises ConfigError if no time is left."""
    period_ns = config.period_ns
    if config.ecu.compute_time_ms * NS_PER_MS >= period_ns:
        raise ConfigError(
            f"ecu.compute_time_ms = {config.ecu.compute_time_ms}: must be less than a control period, "
            f"{period_ns / NS_PER_MS:g} ms"
        )
    compute_ns = round(config.ecu.compute_time_ms * NS_PER_MS)
    pressure, speed, command, status = (
        PeriodicMessage(name=one.name, frame_id=one.frame_id, is_fd=one.is_fd, length=one.length, period_ns=period_ns)
        for one in message_set(config.bus).specs
    )
    everyone = _by_priority((pressure, speed, command, status, *others))
    arrival = message_response_times(everyone, config.bus)[everyone.index(pressure)]
    # If the pressures' response time has no bound, the answers have no bound either: their priority is lower.
    jitter_ns = period_ns if arrival.response_ns is None else arrival.response_ns
    return (
        pressure,
        speed,
        replace(command, offset_ns=compute_ns, jitter_ns=jitter_ns, deadline_ns=period_ns - compute_ns),
        replace(status, offset_ns=compute_ns, jitter_ns=jitter_ns),
    )


def mean_ns(message: PeriodicMessage, bus: BusConfig) -> float:
    """Return the mean time in ns of the message's frames over random contents, which are the same in each call."""
    random = Random(message.frame_id)
    rates = {"nominal_bitrate": bus.nominal_bitrate, "data_bitrate": bus.data_bitrate}
    frames = (message.frame(random.randbytes(message.length)) for _ in range(_CONTENTS))
    return sum(frame_ns(frame, **rates) for frame in frames) / _CONTENTS


def _by_priority(messages: Sequence[PeriodicMessage]) -> list[PeriodicMessage]:
    return sorted(messages, key=lambda message: message.priority)
