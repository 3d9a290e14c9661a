"""A whole log, message by message: what `stillwake can decode` prints, writes and sums up."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import can

from can_bridge.secoc.key import Key
from can_bridge.tools.observed_traffic import Mac, Traffic, observe
from can_bridge.tools.raw_bus import frame_of, id_text
from can_bridge.wire.frame_bits import frame_ns
from contract.config.vehicle import BusConfig


@dataclass(kw_only=True)
class Summary:
    """What a log holds.

    Attributes:
        messages: by (extended, identifier).
        remote, errors, unsound: frames that carry no data, and such as no wire carries.
        first_s, last_s: earliest and latest time of a frame of any kind, wherever it stands; None without one.
        busy_ns: how long the data frames occupied the bus, their stuff bits counted, intermissions included.
    """

    messages: dict[tuple[bool, int], Traffic] = field(default_factory=dict)
    remote: int = 0
    errors: int = 0
    unsound: int = 0
    first_s: float | None = None
    last_s: float | None = None
    busy_ns: int = 0

    @property
    def frames(self) -> int:
        """Data frames."""
        return sum(one.count for one in self.messages.values())

    @property
    def unchecked_macs(self) -> int:
        """Frames of secured messages, if there was no key to check them with."""
        return sum(one.count for one in self.messages.values() if one.mac is Mac.NOT_CHECKED)

    @property
    def span_s(self) -> float:
        """From the earliest to the latest frame; 0 without any."""
        return 0.0 if self.first_s is None or self.last_s is None else self.last_s - self.first_s

    @property
    def load(self) -> float | None:
        """Share of the time that data frames occupied the bus; None where all have one time."""
        return self.busy_ns / 1e9 / self.span_s if self.span_s > 0 else None

    def figures(self) -> dict[str, Any]:
        """For `--json`: rates in 1/s, times in s."""
        return {
            "frames": self.frames,
            "remote_frames": self.remote,
            "error_frames": self.errors,
            "unsound_frames": self.unsound,
            "first_s": self.first_s,
            "last_s": self.last_s,
            "bus_load": self.load,
            "messages": [
                {
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


def summarise(
    messages: Iterable[can.Message],
    *,
    config: BusConfig,
    key: Key | None = None,
    seen: Callable[[Traffic], None] = lambda traffic: None,
) -> Summary:
    """Go through a log.

    Args:
        messages: in the order of the file.
        config: bit rates, for the load, and how counters are judged. A frame without bit-rate switch is charged the
            nominal rate throughout.
        key: of secured messages; without it their authentication is not checked.
        seen: called after each data frame with what is known of its message then.
    """
    summary = Summary()
    for message in messages:
        time_s = message.timestamp
        summary.first_s = time_s if summary.first_s is None else min(time_s, summary.first_s)
        summary.last_s = time_s if summary.last_s is None else max(time_s, summary.last_s)
        if message.is_error_frame:
            summary.errors += 1
            continue
        if message.is_remote_frame:
            summary.remote += 1
            continue
        frame = frame_of(message)
        if frame is None:
            summary.unsound += 1
            continue
        summary.busy_ns += frame_ns(
            frame,
            nominal_bitrate=config.nominal_bitrate,
            data_bitrate=config.data_bitrate if message.bitrate_switch else config.nominal_bitrate,
        )
        place = (frame.is_extended, frame.frame_id)
        summary.messages[place] = observe(summary.messages.get(place), frame, e2e=config.e2e, key=key)
        seen(summary.messages[place])
    return summary
