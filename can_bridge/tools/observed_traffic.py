"""Statistics of one message on a bus from its frames so far: count, rate, losses, results of the end-to-end checks.

The authentication of a secured message is checked first, as in a node; a frame that this check rejects gets no
end-to-end check. Without a key only the end-to-end check is made.
"""

from collections import deque
from dataclasses import replace
from enum import Enum
from typing import Final

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import GOOD, FrameCheck, ReceiverState, receive
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import VerifierState, verified
from can_bridge.tools.signals import Decoded, decode
from can_bridge.wire.frame import Frame
from contract.config.vehicle import E2eConfig

RATE_OVER: Final = 20
"""Number of intervals between successive frames over which the rate is averaged."""
SILENT_AFTER: Final = 5.0
"""Time since the newest frame after which the rate counts as zero, as a multiple of the mean interval."""

CHECK_TEXT: Final = {
    FrameCheck.OK: "OK",
    FrameCheck.OK_SOME_LOST: "some lost",
    FrameCheck.REPEATED: "repeated",
    FrameCheck.WRONG_SEQUENCE: "wrong sequence",
    FrameCheck.ERROR: "CRC wrong",
}


class Mac(Enum):
    """The result of the authentication of a secured frame; the value is the text that tools show."""

    OK = "OK"
    NOT_AUTHENTIC = "not authentic"
    NOT_FRESH = "not fresh"
    NOT_CHECKED = "not checked"
    """The MAC was not checked, because no key is available."""


MAC_REFUSED: Final = (Mac.NOT_AUTHENTIC, Mac.NOT_FRESH)


class Traffic:
    """One message with the statistics of its frames so far.

    Attributes:
        decoded: content of the newest frame; None for a message that is not ours.
        channel: the log's channel on which the frames were recorded; empty on a bus.
        recent_ns: times of the newest frames, oldest first, at most RATE_OVER + 1 times.
        check: result of the newest frame's end-to-end check; None for a message without protection, or if the frame's
            MAC was rejected.
        mac: verdict on the MAC of the newest frame; None for a message without authentication.
        lost: number of frames that are missing according to the counters. The counters do not show the loss of a whole
            counter period or more, and a restart of the sender looks like a loss.
        receiver: state of the end-to-end check, with the number of each result.
    """

    latest: Frame
    decoded: Decoded | None

    def __init__(self, e2e: E2eConfig, key: Key | None = None, channel: str = "", *, carries: str = "") -> None:
        """Start the statistics without any frame. `carries` describes the content of a message that is not ours."""
        self._e2e, self._key, self.channel, self._carries = e2e, key, channel, carries
        self.count = self.first_ns = self.lost = 0
        self.recent_ns = deque[int](maxlen=RATE_OVER + 1)
        self.check: FrameCheck | None = None
        self.mac: Mac | None = None
        self.receiver = ReceiverState()
        self.verifier = VerifierState()

    def add(self, frame: Frame, time_ns: int | None = None) -> None:
        """Add a frame of the message. `time_ns` is its time in a log (it may be below 0); None for its time stamp."""
        time_ns = frame.timestamp_ns if time_ns is None else time_ns
        self.latest, self.decoded = frame, decode(frame)
        self.first_ns = self.first_ns if self.count else time_ns
        self.count += 1
        self.recent_ns.append(time_ns)
        self.check = self.mac = None
        if self.decoded is None:
            return
        spec = self.decoded.spec
        # A frame in the wrong format (CAN FD or classic) has to fail the end-to-end check, so its data are removed.
        whole = frame if frame.is_fd == spec.is_fd else replace(frame, data=b"")
        if spec.is_secured:
            before, self.verifier = self.verifier, verified(self.verifier, (whole,), spec=spec, key=self._key).state
            if self.verifier.not_authentic > before.not_authentic:
                self.mac = Mac.NOT_AUTHENTIC
            elif self.verifier.not_fresh > before.not_fresh:
                self.mac = Mac.NOT_FRESH
            else:
                self.mac = Mac.NOT_CHECKED if self._key is None else Mac.OK
        if self.mac in MAC_REFUSED:
            return
        last = self.receiver.last_counter
        self.receiver, reception = receive(self.receiver, (whole,), spec=spec, config=self._e2e)
        (self.check,) = reception.checks
        if last is not None and self.check in (*GOOD, FrameCheck.WRONG_SEQUENCE):
            profile = profile_of(spec)
            self.lost += (profile.counter_of(whole.data) - last) % profile.counter_period - 1

    @property
    def name(self) -> str:
        """The name of the message, or a description of its content; empty if unknown."""
        return self._carries if self.decoded is None else self.decoded.spec.name

    @property
    def refused(self) -> int:
        return self.receiver.frames_rejected + self.verifier.refused

    @property
    def is_protected(self) -> bool:
        """Whether the message is one of ours; all our messages have an end-to-end check."""
        return self.decoded is not None

    @property
    def is_good(self) -> bool:
        """Whether a receiver would use the newest frame."""
        return self.mac not in MAC_REFUSED and self.check in (None, *GOOD)

    @property
    def verdict(self) -> str:
        """The verdict on the newest frame, in words: the reason to reject the frame, or the result of its end-to-end
        check; empty if the message has no checks."""
        if self.mac is not None and self.mac in MAC_REFUSED:
            return str(self.mac.value)
        return "" if self.check is None else CHECK_TEXT[self.check]

    @property
    def verdicts(self) -> dict[str, int]:
        counts = {CHECK_TEXT[check]: self.receiver.count(check) for check in CHECK_TEXT}
        counts[Mac.NOT_AUTHENTIC.value] = self.verifier.not_authentic
        counts[Mac.NOT_FRESH.value] = self.verifier.not_fresh
        return {text: count for text, count in counts.items() if count}

    @property
    def last_ns(self) -> int:
        return self.recent_ns[-1]

    def age_ns(self, now_ns: int) -> int:
        return max(0, now_ns - self.last_ns)

    def rate_hz(self, now_ns: int) -> float:
        """Return the rate of the newest frames in 1/s; 0 with fewer than two frames, or after a long silence."""
        span = self.recent_ns[-1] - self.recent_ns[0]
        if span <= 0:
            return 0.0
        mean = span / (len(self.recent_ns) - 1)
        return 0.0 if self.age_ns(now_ns) > SILENT_AFTER * mean else 1e9 / mean

    @property
    def mean_rate_hz(self) -> float:
        """The mean rate in 1/s from the first to the newest frame; 0 with fewer than two frames."""
        span = self.last_ns - self.first_ns
        return (self.count - 1) * 1e9 / span if span > 0 else 0.0
