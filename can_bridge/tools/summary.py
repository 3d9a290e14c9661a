"""A summary, by message, of the traffic of a log or a bus. `stillwake can decode` and `can monitor` show it."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Final

import can

from can_bridge.logs.entries import error_class
from can_bridge.secoc.key import Key
from can_bridge.tools.observed_traffic import Mac, Traffic
from can_bridge.tools.raw_bus import frame_of, id_text
from can_bridge.tools.signals import PROTECTION
from can_bridge.wire.frame_bits import frame_ns
from contract.config.vehicle import BusConfig

MOST_MESSAGES: Final = 1000
"""Largest number of listed messages: more than a vehicle has, and a limit for frames with random identifiers."""

SignalCell = tuple[str, str, str]


@dataclass(kw_only=True)
class Summary:
    """The traffic so far.

    Attributes:
        config: settings of the bus, for the load and the rules for counters. A frame without bit-rate switch counts at
            the nominal rate.
        key: key for secured messages; without it their authentication is not checked.
        most: largest number of messages that are listed; frames with further identifiers are only counted, in
            `unlisted`.
        messages: messages by (channel, extended, identifier), because two buses have independent counters.
        errors: numbers of error frames, by the reported error.
        remote, unsound: number of remote frames, and number of impossible frames.
        first_s, last_s: earliest and latest time of a frame of any kind, whatever the order of the frames; None without
            a frame.
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
        frame = frame_of(message)
        if frame is None:
            if message.is_error_frame:
                self.errors[error_class(message)] += 1
            self.remote += message.is_remote_frame and not message.is_error_frame
            self.unsound += not (message.is_error_frame or message.is_remote_frame)
            return None
        channel = "" if message.channel is None else str(message.channel)
        self.busy_ns[channel] += frame_ns(
            frame,
            nominal_bitrate=self.config.nominal_bitrate,
            data_bitrate=self.config.data_bitrate if message.bitrate_switch else self.config.nominal_bitrate,
        )
        place = (channel, frame.is_extended, frame.frame_id)
        if place not in self.messages and len(self.messages) == self.most:
            self.unlisted += 1
            return None
        traffic = self.messages.get(place)
        if traffic is None:
            carries = self.config.diagnosis.names.get(frame.identifier, "")
            traffic = self.messages[place] = Traffic(self.config.e2e, self.key, channel, carries=carries)
        traffic.add(frame, round(time_s * 1e9))
        return traffic


def rows(summary: Summary, *, matching: str = "") -> list[tuple[Traffic, list[SignalCell]]]:
    """Return the messages with their signals, sorted by channel and identifier. An unknown or unreadable message has
    its bytes in place of signals. All words in `matching` must occur in the message's name, identifier or channel, or
    in the signal's name; case is ignored."""
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
