"""A one-line report on the frames that a node receives while it can use none of them."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from can_bridge.bus.interface import Rejection
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import SETS, MessageSet
from can_bridge.wire.message_specs import MessageSpec

MOST_NAMED: Final = 4
"""Largest number of identifiers that the reported line lists."""
SILENCE_S: Final = 1.0
"""Time in s without a usable frame after which the line is reported."""


class Heard(Counter[tuple[int, int]]):
    """A counter of frames by identifier and length. Callers create a new counter after each call of `Silence.look`."""

    def add(self, frames: Iterable[Frame]) -> None:
        for frame in frames:
            if len(self) < 1000 or (frame.frame_id, len(frame.data)) in self:
                self[frame.frame_id, len(frame.data)] += 1


def line(heard: Heard, wanted: MessageSpec, messages: MessageSet, rejected: Counter[Rejection], *, sender: str) -> str:
    """Return a line with the most likely reason why no usable frame arrived in `SILENCE_S`.

    Args:
        wanted: the message that the node waits for, one of the node's `messages`.
        rejected: numbers of receptions that were rejected in this time, by reason.
        sender: word for the node that sends the `wanted` message.
    """
    opening = f"no usable {wanted.name} (0x{wanted.frame_id:03x}) in {SILENCE_S:g} s"
    lengths = {length: count for (frame_id, length), count in heard.items() if frame_id == wanted.frame_id}
    wrong = {length: count for length, count in lengths.items() if length != wanted.length}
    if wrong:
        length = max(wrong, key=wrong.__getitem__)
        return f"{opening}: its frames have {length} bytes, not {wanted.length}, so the {sender} has another DBC"
    if lengths:
        reason = "MAC, counter or CRC is wrong"
        check = "another bus.key or DBC" if wanted.is_secured else "another DBC, or two nodes send them"
        return f"{opening}: {sum(lengths.values())} frames arrived, but their {reason}: {check}"
    ids = {frame_id for frame_id, _ in heard} - {spec.frame_id for spec in messages.specs}
    for other in SETS:
        if ids & {spec.frame_id for spec in other.specs}:
            usual = f"--set bus.frames={'fd' if other.command.spec.is_fd else 'classic'}"
            advice = "it has a key, --set bus.key=FILE" if other.command.spec.is_secured else usual
            return f"{opening}: the other node uses the messages for {other.name}: {advice}"
    if rejected[Rejection.WRONG_FORMAT]:
        there, here = ("classic", "fd") if wanted.is_fd else ("fd", "classic")
        return f"{opening}: the other nodes do not use bus.frames = {here}: --set bus.frames={there}"
    if ids:
        named = ", ".join(f"0x{i:03x}" for i in sorted(ids)[:MOST_NAMED])
        more = "" if len(ids) <= MOST_NAMED else f" and {len(ids) - MOST_NAMED} more"
        return f"{opening}: there is no {sender}; only other nodes send: {named}{more}"
    unusable = [f"{count} {why.value}" for why, count in rejected.items() if count and why is not Rejection.OWN]
    if unusable:
        return f"{opening}: there is no {sender}; the received frames cannot be used: {', '.join(unusable)}"
    return f"{opening}: no frame arrives: there is no {sender} on this bus, or bus.channel is wrong"


class Silence:
    """A reporter that states when usable frames are missing, and when they return. For the arguments see `line`."""

    def __init__(self, wanted: MessageSpec, messages: MessageSet, sender: str, report: Callable[[str], None]) -> None:
        self._wanted, self._messages, self._sender, self._report = wanted, messages, sender, report
        self._usable, self._rejected = 0, Counter[Rejection]()
        self._is_told = False

    def look(self, usable: int, heard: Heard, rejected: Mapping[Rejection, int]) -> None:
        """Evaluate the frames received since the last call. `usable` and `rejected` count all receptions so far."""
        if usable > self._usable:
            if self._is_told:
                self._report(f"usable {self._wanted.name} frames arrive")
            self._is_told = False
        elif not self._is_told:
            new = Counter(rejected) - self._rejected
            # The counter is copied, because the thread that reads the bus may count more frames in the meantime.
            self._report(line(Heard(heard), self._wanted, self._messages, new, sender=self._sender))
            self._is_told = True
        self._usable, self._rejected = usable, Counter(rejected)
