"""What is known of one message on a bus from the frames seen so far: count, rate, losses, end-to-end checks."""

from dataclasses import dataclass, field, replace
from typing import Final

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import GOOD, Check, ReceiverState, receive
from can_bridge.tools.signals import Decoded, Decoder
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import MessageSpec
from contract.config.vehicle import E2eConfig

RATE_OVER: Final = 20
"""Intervals between frames that the rate is the mean of."""
SILENT_AFTER: Final = 5.0
"""Mean intervals without a frame after which the rate counts as zero."""

CHECK_TEXT: Final = {
    Check.OK: "OK",
    Check.OK_SOME_LOST: "some lost",
    Check.REPEATED: "repeated",
    Check.WRONG_SEQUENCE: "wrong sequence",
    Check.ERROR: "CRC wrong",
}


@dataclass(frozen=True, kw_only=True)
class Traffic:
    """One message, by the frames so far.

    Attributes:
        latest: the newest frame.
        decoded: what it says; None if no decoder knows the message.
        count: frames.
        first_ns: time of the first.
        recent_ns: times of the newest, oldest first, at most RATE_OVER + 1.
        check: of the newest, against the ones before it; None without end-to-end protection.
        lost: frames missing by their counters, which cannot tell a loss of a whole counter period or more; a sender
            that starts again counts as one.
        receiver: what the checks must remember, and how often each came out.
    """

    latest: Frame
    decoded: Decoded | None
    count: int = 1
    first_ns: int
    recent_ns: tuple[int, ...]
    check: Check | None = None
    lost: int = 0
    receiver: ReceiverState = field(default_factory=ReceiverState)

    @property
    def name(self) -> str:
        """Of the message; empty if unknown."""
        return "" if self.decoded is None else self.decoded.name

    @property
    def refused(self) -> int:
        """Frames that a receiver would not have used."""
        return self.receiver.frames_rejected

    @property
    def last_ns(self) -> int:
        """Time of the newest frame."""
        return self.recent_ns[-1]

    def age_ns(self, now_ns: int) -> int:
        """Time since the newest frame."""
        return max(0, now_ns - self.last_ns)

    def rate_hz(self, now_ns: int) -> float:
        """Frames a second, over the newest; 0 with fewer than two, or when none came for long."""
        span = self.recent_ns[-1] - self.recent_ns[0]
        if span <= 0:
            return 0.0
        mean = span / (len(self.recent_ns) - 1)
        return 0.0 if self.age_ns(now_ns) > SILENT_AFTER * mean else 1e9 / mean

    @property
    def mean_rate_hz(self) -> float:
        """Frames a second from the first to the newest; 0 with fewer than two."""
        span = self.last_ns - self.first_ns
        return (self.count - 1) * 1e9 / span if span > 0 else 0.0


def observe(before: Traffic | None, frame: Frame, *, decoder: Decoder, e2e: E2eConfig) -> Traffic:
    """What is known after one more frame of the message.

    Args:
        before: None for its first frame.
        frame: stamped with the time it came.
        decoder: what to read it with.
        e2e: which steps of the counter still count as a loss, and not as a wrong sequence.
    """
    decoded = decoder(frame)
    receiver = ReceiverState() if before is None else before.receiver
    check: Check | None = None
    lost = 0
    if decoded is not None and decoded.spec is not None:
        receiver, check, lost = _checked(receiver, frame, decoded.spec, e2e)
    if before is None:
        return Traffic(
            latest=frame,
            decoded=decoded,
            first_ns=frame.timestamp_ns,
            recent_ns=(frame.timestamp_ns,),
            check=check,
            lost=lost,
            receiver=receiver,
        )
    return replace(
        before,
        latest=frame,
        decoded=decoded,
        count=before.count + 1,
        recent_ns=(*before.recent_ns[-RATE_OVER:], frame.timestamp_ns),
        check=check,
        lost=before.lost + lost,
        receiver=receiver,
    )


def _checked(state: ReceiverState, frame: Frame, spec: MessageSpec, e2e: E2eConfig) -> tuple[ReceiverState, Check, int]:
    """The receiver's state after this frame, its check, and how many were lost before it."""
    # A frame of the other kind has nothing that could be checked.
    whole = frame if frame.is_fd == spec.is_fd else replace(frame, data=b"")
    after, reception = receive(state, (whole,), spec=spec, config=e2e)
    (check,) = reception.checks
    last = state.last_counter
    if last is None or check not in (*GOOD, Check.WRONG_SEQUENCE):
        return after, check, 0
    profile = profile_of(spec)
    step = (profile.counter_of(frame.data) - last) % profile.counter_period
    return after, check, step - 1
