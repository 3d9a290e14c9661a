"""The frames of one message in a log, numbered by their E2E counter: which are missing, doubled or out of place.

A log's times are those of reception: a frame may have waited for other traffic, and loggers write in bursts. The
counter numbers the sender's frames, the time only how often the counter has gone round. Where both part for
good, because the sender began again or the logger's clock was set, a new stretch begins; so does one behind a long gap.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from contract.arrays import Array, Index

SLACK: Final = 2.0
"""Periods by which a frame may come earlier or later than its counter implies, measured from the frame before it."""
_LONGEST: Final = 1000
"""Periods without a frame within a stretch: no list of rows grows with a clock that was set."""
_JUMP: Final = 0.5
"""The share of a period by which the clock of one stretch may shift for good: beyond it the counter means nothing."""
_AROUND: Final = 16
"""Frames whose median gives the clock: a burst is shorter, and jitter of 0.4 periods averages out."""


@dataclass(frozen=True, kw_only=True)
class CountedFrame:
    """One frame with a right CRC. `time_s` is that of reception, on the log's clock."""

    time_s: float
    counter: int
    data: bytes


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameStretch:
    """Frames of one sender between two of its starts, in the order of `index`: control periods from the first, (n,)."""

    index: Index
    frames: tuple[CountedFrame, ...]

    @property
    def time_s(self) -> Array:
        """The time of each frame's reception in s, (n,)."""
        return np.array([frame.time_s for frame in self.frames])

    def between(self, a: int, b: int) -> "FrameStretch":
        """Its frames from place a to b, counted from the first of them."""
        return FrameStretch(index=self.index[a:b] - self.index[a], frames=self.frames[a:b])

    def __len__(self) -> int:
        return len(self.frames)


def usual_interval(frames: Sequence[CountedFrame], modulus: int) -> float | None:
    """Median time in s between frames whose counters follow each other; None if no two do."""
    times, counters = np.array([(frame.time_s, frame.counter) for frame in frames]).T
    steps = np.diff(times)[np.diff(counters) % modulus == 1]
    return float(np.median(steps)) if len(steps) else None


def without_repeats(frames: Sequence[CountedFrame], within_s: float) -> list[CountedFrame]:
    """The frames without those that were there already within a time in which the counter cannot come round."""
    kept: list[CountedFrame] = []
    last: dict[bytes, float] = {}
    for frame in frames:
        if abs(frame.time_s - last.get(frame.data, -np.inf)) > within_s:
            kept.append(frame)
        last[frame.data] = frame.time_s
    return kept


def number(frames: Sequence[CountedFrame], *, period_s: float, modulus: int) -> tuple[list[FrameStretch], int, int]:
    """The stretches of one message in the order of time; how many frames were there already; and how many were out of
    place: their counters fit neither what was before nor what came behind.

    Args:
        frames: with right CRCs, in the order of reception.
        period_s: the sender's period on the log's clock, to a few per cent.
        modulus: after so many frames the counter begins again. More than half as many lost in a row show by the
            time alone.
    """
    once = without_repeats(frames, SLACK * period_s)
    parts = _parts(once, period_s, modulus)
    # What lies around a frame that is out of place may be one stretch.
    fitting = [frame for part in parts if len(part) > 1 for _, frame in part] or once
    stretches: list[FrameStretch] = []
    for part in _parts(fitting, period_s, modulus):
        numbers, places = np.unique([k for k, _ in part], return_index=True)
        whole = FrameStretch(index=numbers - numbers[0], frames=tuple(part[k][1] for k in places.tolist()))
        stretches += _cut_at_jumps(whole, period_s)
    return stretches, len(frames) - len(once) + len(fitting) - sum(map(len, stretches)), len(once) - len(fitting)


def _parts(frames: Sequence[CountedFrame], period_s: float, modulus: int) -> list[list[tuple[int, CountedFrame]]]:
    """The frames with their numbers from the first, cut where counter and clock disagree or much is missing."""
    parts: list[list[tuple[int, CountedFrame]]] = []
    newest, before = 0, None
    for frame in frames:
        elapsed = 0.0 if before is None else (frame.time_s - before.time_s) / period_s
        step = 0 if before is None else (frame.counter - before.counter) % modulus
        # Periods by the counters, nearest to those by the clock.
        step += modulus * round((elapsed - step) / modulus)
        if before is None or abs(step - elapsed) > SLACK or step > _LONGEST:
            parts.append([(0, frame)])
            newest, before = 0, frame
            continue
        parts[-1].append((newest + step, frame))
        # A frame that was overtaken does not show where the sender is now.
        if step > 0:
            newest, before = newest + step, frame
    return parts


def _cut_at_jumps(stretch: FrameStretch, period_s: float) -> list[FrameStretch]:
    """The stretch, cut where times shift for good although each frame was within the slack of the one before."""
    late = stretch.time_s - period_s * stretch.index
    cuts, after = [0], 0
    for i in (np.flatnonzero(np.abs(np.diff(late)) > _JUMP * period_s) + 1).tolist():
        here, there = late[max(cuts[-1], i - _AROUND) : i], late[i : i + _AROUND]
        if i >= after and abs(np.median(there) - np.median(here)) > _JUMP * period_s:
            cuts.append(i)
            after = i + _AROUND // 2
    return [stretch.between(a, b) for a, b in pairwise([*cuts, len(stretch)])]
