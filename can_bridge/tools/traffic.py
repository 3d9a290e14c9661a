"""The statistics of the traffic in a log or on a bus, by message: count, rate, losses, results of end-to-end checks.

The authentication of a secured message is checked first, as in a node; a frame that this check rejects gets no
end-to-end check. Without a key only the end-to-end check is made.
"""

from collections import Counter, deque
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Final

import can

from can_bridge.bus.conversion import data_frame_of, id_text
from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import GOOD, FrameCheck, ReceiverState, receive
from can_bridge.logs.entries import error_class
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import VerifierState, verified
from can_bridge.tools.signals import PROTECTION, Decoded, decode
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_ns
from contract.config.vehicle import BusConfig, E2eConfig

MOST_MESSAGES: Final = 1000
"""Largest number of listed messages: more than a vehicle has, and a limit for frames with random identifiers."""
RATE_OVER: Final = 20
"""Number of intervals between successive frames over which the rate is averaged."""
SILENT_AFTER: Final = 5.0
"""Time since the newest frame, in mean intervals between frames, after which the rate counts as zero."""

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
    """A message with the statistics of its frames so far.

    Attributes:
        decoded: content of the newest frame; None for a message that is not ours.
        channel: the log's channel on which the frames were recorded; empty on a bus.
        recent_ns: times of the newest frames, oldest first, at most RATE_OVER + 1 times.
        check: result of the newest frame's end-to-end check; None without protection, or if the MAC was rejected.
        mac: verdict on the MAC of the newest frame; None for a message without authentication.
        lost: number of frames missing by the counters, up to a period in a row; a sender's restart looks like a loss.
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
        """Add a frame of the message. `time_ns` is its time in a log, possibly below 0; None for its time stamp."""
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
            forged, judged = self.verifier.not_authentic, verified(self.verifier, (whole,), spec=spec, key=self._key)
            self.verifier = judged.state
            if judged.none_authentic:
                self.mac = Mac.NOT_AUTHENTIC if judged.state.not_authentic > forged else Mac.NOT_FRESH
                return
            self.mac = Mac.NOT_CHECKED if self._key is None else Mac.OK
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
        """The reason to reject the newest frame, or the result of its end-to-end check; empty without any check."""
        if self.mac in MAC_REFUSED:
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


SignalCell = tuple[str, str, str]


@dataclass(kw_only=True)
class Summary:
    """The statistics of all traffic so far.

    Attributes:
        config: bus settings, from which the load is computed and with which counters are checked. For the load, a frame
            without a bit-rate switch has the nominal rate.
        key: key for secured messages; without it their authentication is not checked.
        most: largest number of messages that are listed; frames of all other messages are only counted, in `unlisted`.
        messages: statistics by (channel, extended, identifier), because message counters of two buses are independent.
        errors: numbers of error frames, by the reported error.
        remote, unsound: number of remote frames, and number of data frames with an invalid identifier, length or time.
        first_s, last_s: earliest and latest time of all frames, whatever their order; None if there is no frame.
        busy_ns: time for which the data frames occupied each bus, including stuff bits and intermissions, by channel.
    """

    config: BusConfig
    key: Key | None = field(default=None, repr=False)
    most: int | None = None
    messages: dict[tuple[str, bool, int], Traffic] = field(default_factory=dict)
    errors: Counter[str] = field(default_factory=Counter)
    unlisted: int = 0
    remote: int = 0
    unsound: int = 0
    first_s: float | None = None
    last_s: float | None = None
    busy_ns: Counter[str] = field(default_factory=Counter)

    @property
    def frames(self) -> int:
        return self.unlisted + sum(one.count for one in self.messages.values())

    @property
    def lost(self) -> int:
        return sum(one.lost for one in self.messages.values())

    @property
    def refused(self) -> int:
        return sum(one.refused for one in self.messages.values())

    @property
    def unchecked_macs(self) -> int:
        """The number of frames of secured messages whose MAC was not checked, because no key was given."""
        return sum(one.count for one in self.messages.values() if one.mac is Mac.NOT_CHECKED)

    @property
    def span_s(self) -> float:
        """The time in s from the earliest to the latest frame; 0 if there is no frame."""
        return 0.0 if self.first_s is None or self.last_s is None else self.last_s - self.first_s

    @property
    def loads(self) -> dict[str, float]:
        """The share of time that data frames occupied each bus, by channel; empty if all frames have equal times."""
        return {name: ns / 1e9 / self.span_s for name, ns in sorted(self.busy_ns.items())} if self.span_s > 0 else {}

    @property
    def load(self) -> float | None:
        """The load of the busiest bus; None if all frames have equal times."""
        return max(self.loads.values(), default=None)

    def figures(self) -> dict[str, Any]:
        """Return the figures for `--json`: rates in 1/s, times in s."""
        return {
            "frames": self.frames,
            "remote_frames": self.remote,
            "error_frames": self.errors.total(),
            "error_classes": dict(self.errors),
            "unsound_frames": self.unsound,
            "first_s": self.first_s,
            "last_s": self.last_s,
            "bus_load": self.load,
            "bus_loads": self.loads,
            "messages": [
                {
                    "channel": one.channel or None,
                    "id": id_text(one.latest),
                    "message": one.name or None,
                    "frames": one.count,
                    "rate_hz": one.mean_rate_hz,
                    "first_s": one.first_ns / 1e9,
                    "last_s": one.last_ns / 1e9,
                    "lost": one.lost if one.is_protected else None,
                    "checks": one.verdicts if one.is_protected else None,
                    "mac_checked": None if one.mac is None else one.mac is not Mac.NOT_CHECKED,
                }
                for _, one in sorted(self.messages.items())
            ],
        }

    def add(self, message: can.Message) -> Traffic | None:
        """Add a frame with its time stamp; return its message's statistics, or None if the message is not listed."""
        time_s = message.timestamp
        self.first_s = time_s if self.first_s is None else min(time_s, self.first_s)
        self.last_s = time_s if self.last_s is None else max(time_s, self.last_s)
        if (frame := data_frame_of(message)) is None:
            if message.is_error_frame:
                self.errors[error_class(message)] += 1
            self.remote += message.is_remote_frame and not message.is_error_frame
            self.unsound += not (message.is_error_frame or message.is_remote_frame)
            return None
        channel = "" if message.channel is None else str(message.channel)
        slow = self.config.nominal_bitrate
        fast = self.config.data_bitrate if message.bitrate_switch else slow
        self.busy_ns[channel] += frame_ns(frame, nominal_bitrate=slow, data_bitrate=fast)
        place = (channel, frame.is_extended, frame.frame_id)
        if place not in self.messages and len(self.messages) == self.most:
            self.unlisted += 1
            return None
        if (traffic := self.messages.get(place)) is None:
            carries = self.config.diagnosis.names.get(frame.identifier, "")
            traffic = self.messages[place] = Traffic(self.config.e2e, self.key, channel, carries=carries)
        traffic.add(frame, round(time_s * 1e9))
        return traffic


def rows(summary: Summary, *, matching: str = "") -> list[tuple[Traffic, list[SignalCell]]]:
    """Return the messages with their signals, sorted by channel and identifier; an unknown or unreadable one has its
    bytes. All words in `matching` must occur in name, identifier or channel, or in the signal's name, in any case."""
    words = matching.lower().split()
    shown = []
    for _, traffic in sorted(summary.messages.items()):
        head = f"{traffic.name or 'unknown'} {id_text(traffic.latest)} {traffic.channel}"
        cells = [one for one in _cells(traffic) if all(word in f"{head} {one[0]}".lower() for word in words)]
        if cells:
            shown.append((traffic, cells))
    return shown


def _cells(traffic: Traffic) -> list[SignalCell]:
    signals = () if traffic.decoded is None else traffic.decoded.signals
    cells = [(one.name, one.shown, one.unit) for one in signals if one.name not in PROTECTION]
    what = "data" if traffic.decoded is None else "not readable"
    return cells or [(what, traffic.latest.data.hex(" ") or "empty", "")]
