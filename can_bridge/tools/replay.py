"""Replay: the messages of a log on a bus, at the times at which they were recorded.

Each message is due at an absolute time: the first one's, plus how much later it was recorded. So nothing adds up: a
message that was sent late does not make the next one late.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field, replace

import can

from can_bridge.tools.raw_bus import id_text
from contract.errors import BusError


@dataclass(frozen=True, kw_only=True)
class LogSpan:
    """What a log holds, known before the first message is sent.

    Attributes:
        frames: that are to be sent.
        left_out: error frames and frames of other identifiers.
        first_s, last_s: times of the first and last one that is to be sent.
    """

    frames: int
    left_out: int
    first_s: float
    last_s: float

    @property
    def span_s(self) -> float:
        """From the first to the last."""
        return self.last_s - self.first_s

    @property
    def round_s(self) -> float:
        """From the first to the first of the next round: a mean interval after the last. A second if all have one
        time, so that no round takes none."""
        return self.span_s * self.frames / (self.frames - 1) if self.span_s > 0 else 1.0


def is_sent(message: can.Message, only: Collection[int] | None) -> bool:
    """Whether replay sends a message: no error frame, and of one of the identifiers, if some are named."""
    return not message.is_error_frame and (only is None or message.arbitration_id in only)


def span_of(name: str, messages: Iterable[can.Message], only: Collection[int] | None = None) -> LogSpan:
    """Look through a log.

    Args:
        name: of the log, for errors.
        messages: in the order of the file.
        only: identifiers to send; None for all.

    Raises:
        BusError: if a time goes back, or nothing is to be sent.
    """
    frames = left_out = 0
    first = last = 0.0
    before: can.Message | None = None
    for number, message in enumerate(messages, 1):
        if before is not None and message.timestamp < before.timestamp:
            raise BusError(
                f"{name}: time goes back at frame {number} ({id_text(message)}), from {before.timestamp:.6f} to "
                f"{message.timestamp:.6f} s; a replay needs times in order"
            )
        before = message
        if not is_sent(message, only):
            left_out += 1
            continue
        first = message.timestamp if frames == 0 else first
        last = message.timestamp
        frames += 1
    if frames == 0:
        raise BusError(f"{name}: holds no CAN frame" + (f" to send among its {left_out}" if left_out else ""))
    return LogSpan(frames=frames, left_out=left_out, first_s=first, last_s=last)


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """What was sent, and how late.

    Attributes:
        sent: frames.
        late_us: how often a frame was sent so many whole microseconds after it was due.
    """

    sent: int = 0
    late_us: Counter[int] = field(default_factory=Counter)

    def late_ms(self, share: float) -> float:
        """The lateness in ms that this share of the frames does not exceed (nearest rank); 1.0 for the largest."""
        rank, seen = max(1, -(-self.sent * share // 1)), 0
        for late in sorted(self.late_us):
            seen += self.late_us[late]
            if seen >= rank:
                return late / 1e3
        return 0.0


def replay(
    messages: Iterable[can.Message],
    send: Callable[[can.Message], None],
    *,
    span: LogSpan,
    only: Collection[int] | None = None,
    speed: float = 1.0,
    start_ns: int,
    clock_ns: Callable[[], int],
    sleep: Callable[[float], None],
    so_far: Replayed | None = None,
    progress: Callable[[int], None] = lambda sent: None,
    is_over: Callable[[], bool] = lambda: False,
) -> Replayed:
    """Send one round of a log.

    Args:
        messages: as `span_of` was given them.
        send: hands one to the bus.
        span: of the log.
        only: identifiers to send; None for all.
        speed: so many recorded seconds pass in one.
        start_ns: when the first message is due, in the time of `clock_ns`.
        clock_ns, sleep: a clock that never goes back, and what waits for so many seconds.
        so_far: the outcome of the rounds before.
        progress: called with the number of frames sent, rounds before included.
        is_over: asked before each frame.
    """
    done = Replayed() if so_far is None else so_far
    late_us = Counter(done.late_us)
    sent = done.sent
    for message in messages:
        if not is_sent(message, only):
            continue
        due_ns = start_ns + round((message.timestamp - span.first_s) * 1e9 / speed)
        while (left_ns := due_ns - clock_ns()) > 0:
            if is_over():
                return Replayed(sent=sent, late_us=late_us)
            # In pieces, so that a long gap can be stopped.
            sleep(min(left_ns, 200_000_000) / 1e9)
        if is_over():
            break
        late_us[max(0, clock_ns() - due_ns) // 1000] += 1
        send(message)
        sent += 1
        progress(sent)
    return replace(done, sent=sent, late_us=late_us)
