"""The simulated bus against the worst-case response times that the analysis gives, over random sets of messages.

Every set is played in two ways. At the critical instant: the longest frame of lower priority has just begun when a
message and all of higher priority are queued at once, each as late as its jitter lets it be, and from then on without
delay. Contents are constant there, so the analysis is asked with the frames' true lengths, which leaves it no margin.
And at random: phases, delays and contents.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from random import Random
from statistics import median
from typing import Any, Final, NamedTuple

from can_bridge.bus.simulated.attempt import INTERMISSION
from can_bridge.bus.simulated.medium import SimulatedBus, Transmission
from can_bridge.timing.periodic_message import PeriodicMessage
from can_bridge.timing.response_time import Response, nominal_bit_ns, response_times, timing
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, MAX_EXTENDED_ID, MAX_FRAME_ID, Frame
from can_bridge.wire.priority import Priority
from contract.config.vehicle import BusConfig
from tests.proofs.command_line import track

SETS: Final = 1000
MESSAGES: Final = (2, 12)
"""Fewest and most in a set."""
LOADS: Final = (0.3, 0.98)
"""Load of the bus by a set, at worst."""
LEVELS: Final = 4
"""Messages of a set that are played at their critical instants, the last one among them."""
LONGEST: Final = 400
"""Frames of one message in one play, at most."""
BIT_RATES: Final = ((125_000, 500_000), (250_000, 1_000_000), (500_000, 2_000_000), (1_000_000, 5_000_000))
PATTERNS: Final = (0x00, 0xFF, 0x0F, 0xF0, 0x1E, 0xE1, 0x3C, 0xC3, 0x78, 0x87)
"""Bytes whose repetition needs many stuff bits; the one that makes a message's frame longest is taken."""


class Sent(NamedTuple):
    """One frame to send: due at `release_ns`, which may be negative, and queued at `queued_ns`."""

    release_ns: int
    queued_ns: int
    frame: Frame


class Played(NamedTuple):
    """The longest time of every message from release to the end of the intermission, 0 without a frame; all frames."""

    longest_ns: list[int]
    frames: int


def measure(*, sets: int = SETS, seed: int = 0) -> dict[str, Any]:
    """Play random sets of messages.

    Returns:
        response_time_violations: messages that were later than the analysis allows, a play each.
        message_sets, messages, frames: how many were played.
        largest_ratio: of a response to its bound; with_true_lengths: with constant contents, the bound being made of
            their lengths: 1 means that it is reached.
        reached_percent: of the critical instants, in which the response is the bound to the bit.
        median_ratio: of all messages at random, to the bound for any content.
    """
    tight, loose = [], []
    violations = frames = messages = 0
    for number in track(range(sets), "response time", "sets of messages"):
        random = Random(f"{seed} {number}")
        nominal, data = random.choice(BIT_RATES)
        bus = BusConfig(frames=random.choice(("fd", "classic")), nominal_bitrate=nominal, data_bitrate=data)
        drawn = random_set(bus, random)
        messages, last = messages + len(drawn), len(drawn) - 1
        contents = [longest_frame(message, bus) for message in drawn]
        for level in (*random.sample(range(last), min(LEVELS - 1, last)), last):
            bound, played = at_critical_instant(drawn, contents, level, bus)
            frames += played.frames
            if bound.response_ns is not None:
                violations += played.longest_ns[level] > bound.response_ns
                tight.append((played.longest_ns[level], bound.response_ns, nominal_bit_ns(bus)))
        bounds, played = at_random(drawn, bus, random)
        frames += played.frames
        for bound, longest in zip(bounds, played.longest_ns, strict=True):
            if bound.response_ns is not None:
                violations += longest > bound.response_ns
                loose.append(longest / bound.response_ns)
    return {
        "response_time_violations": violations,
        "message_sets": sets,
        "messages": messages,
        "frames": frames,
        "largest_ratio": max(loose),
        "median_ratio": median(loose),
        "critical_instants": len(tight),
        "largest_ratio_with_true_lengths": max(longest / bound for longest, bound, _ in tight),
        "reached_percent": 100 * sum(bound - longest <= bit for longest, bound, bit in tight) / len(tight),
    }


def at_critical_instant(
    messages: Sequence[PeriodicMessage], contents: Sequence[Frame], level: int, bus: BusConfig
) -> tuple[Response, Played]:
    """The bound of the message of this level, the highest priority first, and what it met with constant contents."""
    wire = SimulatedBus(bus)
    lengths = [wire.frame_ns(frame) for frame in contents]
    exact = [replace(timing(message, bus), frame_ns=length) for message, length in zip(messages, lengths, strict=True)]
    bound = response_times(exact, bit_ns=nominal_bit_ns(bus))[level]
    # Twice as long as the analysis looks, in case that it looks too short.
    until_ns = 2 * (bound.instance * messages[level].period_ns + (bound.response_ns or messages[level].period_ns))
    pairs = zip(messages[: level + 1], contents, strict=False)
    plans = [list(_after_one_delay(message, frame, 1, until_ns)) for message, frame in pairs]
    if lower := range(level + 1, len(messages)):
        plans.append([Sent(0, 0, contents[max(lower, key=lambda one: lengths[one])])])
    return bound, play(plans, bus)


def at_random(messages: Sequence[PeriodicMessage], bus: BusConfig, random: Random) -> tuple[list[Response], Played]:
    """The bounds for any content, and what the messages met with random phases, delays and contents."""
    bounds = response_times([timing(message, bus) for message in messages], bit_ns=nominal_bit_ns(bus))
    until_ns = 3 * max(message.period_ns for message in messages)
    return bounds, play([list(_at_random(message, until_ns, random)) for message in messages], bus)


def play(plans: Sequence[Sequence[Sent]], bus: BusConfig) -> Played:
    """Send everything over a simulated bus, a node each message, until the last frame has arrived."""
    total, done, longest = sum(map(len, plans)), 0, [0] * len(plans)
    levels = {(plan[0].frame.frame_id, plan[0].frame.is_extended): level for level, plan in enumerate(plans) if plan}
    releases = [deque(sent.release_ns for sent in plan) for plan in plans]
    intermission_ns = INTERMISSION * nominal_bit_ns(bus)

    def observe(transmission: Transmission) -> None:
        nonlocal done
        level = levels[transmission.frame.frame_id, transmission.frame.is_extended]
        longest[level] = max(longest[level], transmission.end_ns + intermission_ns - releases[level].popleft())
        done += 1

    wire = SimulatedBus(bus, observe=observe)
    # Who listens acknowledges; a node alone would never be done.
    wire.port("listener", receive_capacity=1)
    for level, plan in enumerate(plans):
        if plan:
            port = wire.port(f"node {level}", transmit_capacity=len(plan))
            for sent in plan:
                wire.call_at(sent.queued_ns, partial(port.send, sent.frame))
    while done < total:
        wire.advance_until(wire.now_ns + 10**9, lambda: done == total)
    return Played(longest, total)


def random_set(bus: BusConfig, random: Random) -> list[PeriodicMessage]:
    """Messages of both formats and all lengths that load the bus to a random degree, the highest priority first."""
    count = random.randint(*MESSAGES)
    probes: dict[Priority, PeriodicMessage] = {}
    while len(probes) < count:
        is_extended, is_fd = random.random() < 0.3, bus.frames == "fd" and random.random() < 0.7
        message = PeriodicMessage(
            name=f"message {len(probes)}",
            frame_id=random.randint(0, MAX_EXTENDED_ID if is_extended else MAX_FRAME_ID),
            is_extended=is_extended,
            is_fd=is_fd,
            length=random.choice(FD_LENGTHS if is_fd else CLASSIC_LENGTHS),
            # Half of the messages have one of few periods, so that their frames meet again and again.
            period_ns=10**6 * random.choice((5, 10, 20)) if random.random() < 0.5 else random.randint(2, 40) * 10**6,
        )
        probes[message.priority] = message
    load = float(sum(Fraction(message.worst_ns(bus), message.period_ns) for message in probes.values()))
    factor = load / random.uniform(*LOADS)
    return [_stretched(probes[key], factor, random) for key in sorted(probes)]


def longest_frame(message: PeriodicMessage, bus: BusConfig) -> Frame:
    """Its frame with the content of `PATTERNS` that takes longest."""
    wire = SimulatedBus(bus)
    return max((message.frame(bytes([byte]) * message.length) for byte in PATTERNS), key=wire.frame_ns)


def _stretched(message: PeriodicMessage, factor: float, random: Random) -> PeriodicMessage:
    period_ns = round(message.period_ns * factor)
    jitter_ns = random.choice((0, 0, round(random.random() * period_ns), round(random.random() * 2 * period_ns)))
    return replace(message, period_ns=period_ns, jitter_ns=jitter_ns)


def _after_one_delay(message: PeriodicMessage, frame: Frame, begin_ns: int, until_ns: int) -> Iterator[Sent]:
    """From `begin_ns` on: a frame that its whole jitter has delayed, and then each one as soon as it may come."""
    release_ns = begin_ns - message.jitter_ns
    for _ in range(LONGEST):
        queued_ns = max(begin_ns, release_ns)
        if queued_ns > begin_ns + until_ns:
            return
        yield Sent(release_ns, queued_ns, frame)
        release_ns += message.period_ns


def _at_random(message: PeriodicMessage, until_ns: int, random: Random) -> Iterator[Sent]:
    queued_ns = 0
    release_ns = random.randrange(message.period_ns)
    while release_ns < until_ns:
        queued_ns = max(queued_ns, release_ns + random.randint(0, message.jitter_ns))
        yield Sent(release_ns, queued_ns, message.frame(random.randbytes(message.length)))
        release_ns += message.period_ns
