"""The pressures and commands in a recorded log: frames of our messages whose CRC is right, and counts of all others."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import can

from can_bridge.drives.counted_frames import CountedFrame
from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.message_sets import SETS, MessageSet
from can_bridge.wire.message_specs import MessageSpec
from contract.errors import DatasetError

Verify = Callable[[MessageSpec, bytes], int | None]
"""The freshness value of a secured message with the right authentication code; None for any other bytes."""

_SHOWN: Final = 12
"""Identifiers listed in a message."""


@dataclass(frozen=True, kw_only=True)
class LogFrames:
    """What a log holds for us.

    Attributes:
        messages: the set that its pressures are of.
        pressures, commands: those with a right CRC, in the order of the log; if it was asked, authentic and fresh ones.
        damaged: frames of the two messages with a wrong CRC or length.
        forged: frames with a wrong authentication code, or an old freshness value.
        foreign: all other frames.
    """

    messages: MessageSet
    pressures: tuple[CountedFrame, ...]
    commands: tuple[CountedFrame, ...]
    damaged: int
    forged: int
    foreign: int


def frames_of(
    path: Path,
    messages: Iterable[can.Message],
    *,
    only: MessageSet | None = None,
    verify: Verify | None = None,
    back_s: float,
) -> LogFrames:
    """Sort a log's messages. Raises DatasetError if no pressure or no command has a right CRC, there are pressures of
    two sets, or times go back.

    Args:
        messages: in the order of the log.
        only: the set of messages to read; without one, the set that the log has pressures of.
        verify: of secured messages; without it, freshness and authentication codes are not looked at.
        back_s: time by which a message may be older than one in front of it.
    """
    kept: dict[int, list[CountedFrame]] = {}
    damaged, forged, seen = Counter[int](), Counter[int](), Counter[int]()
    sets = SETS if only is None else (only,)
    specs = {spec.frame_id: spec for one in sets for spec in (one.pressure.spec, one.command.spec)}
    fresh: dict[int, int] = {}
    latest = float("-inf")
    for message in messages:
        if message.is_error_frame or message.is_remote_frame:
            seen[-1] += 1
            continue
        # Extended identifiers are another node's, whatever their number.
        frame_id = message.arbitration_id + (message.is_extended_id << 32)
        seen[frame_id] += 1
        spec = specs.get(frame_id)
        if spec is None:
            continue
        data = bytes(message.data)
        profile = profile_of(spec)
        covered = data[: spec.protected]
        if len(data) != spec.length or not profile.check(covered, data_id=spec.data_id):
            damaged[frame_id] += 1
            continue
        if spec.is_secured and verify is not None:
            freshness = verify(spec, data)
            # The same value again is the same frame again, which its counter shows.
            if freshness is None or freshness < fresh.get(frame_id, 0):
                forged[frame_id] += 1
                continue
            fresh[frame_id] = freshness
        if message.timestamp < latest - back_s:
            raise DatasetError(
                f"{path}: times go back from {latest:.6f} to {message.timestamp:.6f} s: two logs in one file, or "
                f"a logger whose clock was set; cut it there"
            )
        latest = max(latest, message.timestamp)
        frame = CountedFrame(time_s=message.timestamp, counter=profile.counter_of(covered), data=covered)
        kept.setdefault(frame_id, []).append(frame)
    present = [one for one in sets if one.pressure.spec.frame_id in kept]
    without = partial(_without, path, damaged, forged, seen)
    if not present:
        raise without("pressure", [one.pressure.spec for one in sets])
    if len(present) > 1:
        names = " and ".join(f"{one.pressure.spec.name} (0x{one.pressure.spec.frame_id:x})" for one in present)
        raise DatasetError(
            f"{path}: holds {names}; choose one with --set bus.frames=fd or classic (and bus.key for the secured ones)"
        )
    pressure, command = present[0].pressure.spec, present[0].command.spec
    if command.frame_id not in kept:
        raise without("command", [command], "; without commands it is unknown what the jets did")
    ids = (pressure.frame_id, command.frame_id)
    return LogFrames(
        messages=present[0],
        pressures=tuple(kept[ids[0]]),
        commands=tuple(kept[ids[1]]),
        damaged=sum(damaged[one] for one in ids),
        forged=sum(forged[one] for one in ids),
        foreign=sum(seen.values()) - sum(seen[one] for one in ids),
    )


def _without(
    path: Path,
    damaged: Counter[int],
    forged: Counter[int],
    seen: Counter[int],
    kind: str,
    specs: Sequence[MessageSpec],
    so: str = "",
) -> DatasetError:
    """Why no frame of these messages is left, and what the log has instead."""
    wanted = " or ".join(f"{spec.name} (0x{spec.frame_id:x})" for spec in specs)
    for counts, reason in (
        (forged, "authentication code: bus.key is not the key of this drive"),
        (damaged, "CRC or length"),
    ):
        if count := sum(counts[spec.frame_id] for spec in specs):
            return DatasetError(
                f"{path}: no {kind} can be used: all {count} frames of {wanted} have a wrong {reason}{so}"
            )
    ids = sorted(one for one in seen if one >= 0)
    texts = ", ".join(f"0x{one & 0x1FFFFFFF:x}{' (extended)' if one >> 32 else ''}" for one in ids[:_SHOWN])
    more = f" and {len(ids) - _SHOWN} more" if len(ids) > _SHOWN else ""
    has = f"the identifiers in it are {texts}{more}" if ids else "it holds no data frame at all"
    return DatasetError(f"{path}: holds no {kind}, {wanted}; {has}{so}")
