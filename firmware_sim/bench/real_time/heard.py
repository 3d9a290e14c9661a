"""What a vehicle hears on the bus while no command that it can use arrives, in one line."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from can_bridge.bus.rejection import Rejection
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import SETS, MessageSet

MOST_NAMED: Final = 4
"""Identifiers in the line."""

_SET_OPTIONS: Final = {"classic CAN": "bus.frames=classic", "CAN FD": "bus.frames=fd"}


@dataclass(kw_only=True, eq=False)
class Heard:
    """Frames since the last line, by identifier and length."""

    frames: Counter[tuple[int, int]] = field(default_factory=Counter)

    def add(self, frames: Iterable[Frame]) -> None:
        """More of them."""
        for frame in frames:
            if len(self.frames) < 1000 or (frame.frame_id, len(frame.data)) in self.frames:
                self.frames[frame.frame_id, len(frame.data)] += 1


def line(heard: Heard, messages: MessageSet, rejected: Mapping[Rejection, int], *, seconds: float) -> str:
    """Why no command came, as far as the bus shows.

    Args:
        heard: what was received.
        messages: the set that this vehicle takes.
        rejected: receptions that were no frame of this vehicle's kind, by reason.
        seconds: how long it listened.
    """
    spec = messages.command.spec
    opening = f"no usable {spec.name} (0x{spec.frame_id:03x}) in {seconds:g} s"
    lengths = {length: count for (frame_id, length), count in heard.frames.items() if frame_id == spec.frame_id}
    wrong = {length: count for length, count in lengths.items() if length != spec.length}
    if wrong:
        length = max(wrong, key=wrong.__getitem__)
        return f"{opening}: it comes with {length} bytes and not {spec.length}, so the ECU has another DBC"
    if lengths:
        reason = "MAC, counter or CRC are not right"
        check = "another bus.key or DBC" if spec.is_secured else "another DBC, or two nodes that send it"
        return f"{opening}: {sum(lengths.values())} came, but their {reason}: {check}"
    other = _other_set(heard, messages)
    if other is not None:
        return f"{opening}: the other node uses the messages for {other.name}{_advice(other)}"
    if rejected.get(Rejection.WRONG_FORMAT, 0):
        there, here = ("classic", "fd") if spec.is_fd else ("fd", "classic")
        return f"{opening}: the other nodes' frames are not for bus.frames = {here}: --set bus.frames={there}"
    own = messages.pressure.spec.frame_id
    others = {frame_id: count for (frame_id, _), count in heard.frames.items() if frame_id != own}
    if others:
        named = ", ".join(f"0x{i:03x}" for i in sorted(others)[:MOST_NAMED])
        more = "" if len(others) <= MOST_NAMED else f" and {len(others) - MOST_NAMED} more"
        return f"{opening}: no ECU; heard are other nodes' {named}{more}"
    foreign = {reason: count for reason, count in rejected.items() if count and reason is not Rejection.OWN}
    unusable = [f"{count} {reason.value}" for reason, count in foreign.items()]
    if unusable:
        return f"{opening}: no ECU; what is heard cannot be used: {', '.join(unusable)}"
    return f"{opening}: nothing at all is heard; no ECU on this bus, or it is another bus.channel"


def _other_set(heard: Heard, messages: MessageSet) -> MessageSet | None:
    ids = {frame_id for frame_id, _ in heard.frames}
    for candidate in SETS:
        if candidate is not messages and ids & {candidate.command.spec.frame_id, candidate.status.spec.frame_id}:
            return candidate
    return None


def _advice(other: MessageSet) -> str:
    if other.command.spec.is_secured:
        return ": it has a key, --set bus.key=FILE"
    option = _SET_OPTIONS.get(other.name)
    return "" if option is None else f": --set {option}"
