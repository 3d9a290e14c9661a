"""The pressures, commands and speeds in a log: our frames with a valid CRC on one channel. Other frames are counted."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import can

from can_bridge.drives.counted_frames import CountedFrame
from can_bridge.e2e.profiles import profile_of
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import verify
from can_bridge.wire.message_sets import SETS, MessageSet
from can_bridge.wire.message_specs import MessageSpec
from contract.errors import DatasetError

_SHOWN: Final = 12


@dataclass(frozen=True, kw_only=True)
class LogFrames:
    """The frames of our messages in a log.

    Attributes:
        channel: the channel with our frames; empty if the log has no channels.
        pressures, commands, speeds: frames with a valid CRC, in the log's order; with a key, authentic, fresh ones.
        damaged: number of frames of these three messages with a wrong CRC or length.
        forged: number of frames with a wrong authentication code or an old freshness value.
        others: counts of all other frames on all channels, by kind.
    """

    messages: MessageSet
    channel: str
    pressures: tuple[CountedFrame, ...]
    commands: tuple[CountedFrame, ...]
    speeds: tuple[CountedFrame, ...]
    damaged: int
    forged: int
    others: Mapping[str, int]


def frames_of(
    path: Path, messages: Iterable[can.Message], *, only: MessageSet | None, key: Key | None, back_s: float
) -> LogFrames:
    """Sort a log's messages by their kind. Raises DatasetError if no pressure or no command has a valid CRC, the
    pressures belong to two message sets, our frames are on two channels, or a time is more than `back_s` earlier than a
    time before it. `only` is the message set to read; if None, the set of the pressures in the log. Without `key`,
    freshness and authentication codes are not checked."""
    buses: dict[str, _Bus] = {}
    others = Counter[str]()
    sets = SETS if only is None else (only,)
    specs = {spec.frame_id: spec for one in sets for spec in one.specs}
    for message in messages:
        if message.is_error_frame or message.is_remote_frame:
            others["error frames" if message.is_error_frame else "remote frames"] += 1
            continue
        channel = "" if message.channel is None else str(message.channel)
        buses.setdefault(channel, _Bus()).add(message, specs, key, back_s)
    channel = _channel_of(path, buses, specs)
    bus = buses.get(channel, _Bus())
    if bus.goes_back is not None:
        raise DatasetError(
            f"{path}: the times go back from {bus.goes_back[0]:.6f} to {bus.goes_back[1]:.6f} s, because the file has "
            f"two logs or the logger's clock was set; split the file there"
        )
    present = [one for one in sets if one.pressure.spec.frame_id in bus.kept]
    if not present:
        raise DatasetError(f"{path}: {bus.lacks('pressure', [one.pressure.spec for one in sets])}")
    if len(present) > 1:
        names = " and ".join(f"{one.pressure.spec.name} (0x{one.pressure.spec.frame_id:x})" for one in present)
        choose = "choose one set with --set bus.frames=fd or classic (and bus.key if secured)"
        raise DatasetError(f"{path}: holds {names}; {choose}")
    pressure, command = present[0].pressure.spec, present[0].command.spec
    if command.frame_id not in bus.kept:
        lacks = bus.lacks("command", [command])
        raise DatasetError(f"{path}: {lacks}; without commands the actions of the jets are unknown")
    ids = (pressure.frame_id, command.frame_id, present[0].speed.spec.frame_id)
    others["of other messages"] = bus.seen.total() - sum(bus.seen[one] for one in ids)
    others["on other channels"] = sum(other.seen.total() for name, other in buses.items() if name != channel)
    return LogFrames(
        messages=present[0],
        channel=channel,
        pressures=tuple(bus.kept[ids[0]]),
        commands=tuple(bus.kept[ids[1]]),
        speeds=tuple(bus.kept.get(ids[2], ())),
        damaged=sum(bus.damaged[one] for one in ids),
        forged=sum(bus.forged[one] for one in ids),
        others=others,
    )


class _Bus:
    """The frames of one channel, by identifier: frames to use, and numbers of frames with a valid CRC (`sound`), of
    damaged, forged and all data frames (`seen`). `goes_back` has the times in s around the first decrease."""

    def __init__(self) -> None:
        self.kept: dict[int, list[CountedFrame]] = {}
        self.sound, self.damaged = Counter[int](), Counter[int]()
        self.forged, self.seen = Counter[int](), Counter[int]()
        self.goes_back: tuple[float, float] | None = None
        self._fresh: dict[int, int] = {}
        self._latest = float("-inf")

    def add(self, message: can.Message, specs: Mapping[int, MessageSpec], key: Key | None, back_s: float) -> None:
        # A 29-bit identifier belongs to another node. The addition makes its number differ from all 11-bit identifiers.
        frame_id = message.arbitration_id + (message.is_extended_id << 32)
        self.seen[frame_id] += 1
        if (spec := specs.get(frame_id)) is None:
            return
        data = bytes(message.data)
        profile = profile_of(spec)
        covered = data[: spec.protected]
        if len(data) != spec.length or not profile.check(covered, data_id=spec.data_id):
            self.damaged[frame_id] += 1
            return
        self.sound[frame_id] += 1
        if spec.is_secured and key is not None:
            freshness = verify(data, spec, key)
            # A frame with an equal freshness value is a repetition. It is kept, because repetitions are removed later.
            if freshness is None or freshness < self._fresh.get(frame_id, 0):
                self.forged[frame_id] += 1
                return
            self._fresh[frame_id] = freshness
        if message.timestamp < self._latest - back_s:
            self.goes_back = self.goes_back or (self._latest, message.timestamp)
        self._latest = max(self._latest, message.timestamp)
        frame = CountedFrame(time_s=message.timestamp, counter=profile.counter_of(covered), data=covered)
        self.kept.setdefault(frame_id, []).append(frame)

    def lacks(self, kind: str, specs: Sequence[MessageSpec]) -> str:
        """Return a text that states why no frame of these messages is usable, and which other frames there are."""
        wanted = " or ".join(f"{spec.name} (0x{spec.frame_id:x})" for spec in specs)
        for counts, reason in (
            (self.forged, "authentication code: bus.key is not the key of this drive"),
            (self.damaged, "CRC or length"),
        ):
            if count := sum(counts[spec.frame_id] for spec in specs):
                return f"no {kind} can be used: all {count} frames of {wanted} have a wrong {reason}"
        ids = sorted(self.seen)
        texts = ", ".join(f"0x{one & 0x1FFFFFFF:x}{' (extended)' if one >> 32 else ''}" for one in ids[:_SHOWN])
        more = f" and {len(ids) - _SHOWN} more" if len(ids) > _SHOWN else ""
        has = f"the identifiers in it are {texts}{more}" if ids else "it holds no data frame at all"
        return f"holds no {kind}, {wanted}; {has}"


def _channel_of(path: Path, buses: Mapping[str, _Bus], specs: Mapping[int, MessageSpec]) -> str:
    """Return the channel that has our frames. A CRC can be valid by chance, so the function prefers channels on which
    at least half of the frames of one of our messages are valid."""
    ours = {
        name: [(specs[one].name, count) for one, count in sorted(bus.sound.items()) if count >= bus.damaged[one]]
        for name, bus in buses.items()
    }
    found = [name for name, messages in ours.items() if messages] or [name for name, bus in buses.items() if bus.sound]
    if len(found) > 1:
        texts = (f"{name} ({', '.join(f'{count} {kind}' for kind, count in ours[name])})" for name in sorted(found))
        channels = " and ".join(texts)
        raise DatasetError(f"{path}: holds stillwake's frames on the channels {channels}; choose one with --channel")
    return found[0] if found else next((name for name, bus in buses.items() if bus.damaged), next(iter(buses), ""))
