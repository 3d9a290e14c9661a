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
class Stretch:
    """Frames of one sender between two of its starts.

    Attributes:
        index: of each frame in control periods from the first, rising, (n,).
        frames: in the order of their index.
    """

    index: Index
    frames: tuple[CountedFrame, ...]

    @property
    def time_s(self) -> Array:
        """The time of each frame's reception in s, (n,)."""
        return np.array([frame.time_s for frame in self.frames])

    def __len__(self) -> int:
        return len(self.frames)


@dataclass(frozen=True, kw_only=True)
class Numbered:
    """What a message's frames were.

    Attributes:
        stretches: in the order of time; empty without a frame.
        duplicates: frames that were there already.
        misplaced: frames whose counter fits neither what was before nor what came behind.
    """

    stretches: tuple[Stretch, ...]
    duplicates: int
    misplaced: int


def usual_interval(frames: Sequence[CountedFrame], modulus: int) -> float | None:
    """Median time in s between frames whose counters follow each other; None if no two do."""
    steps = [
        after.time_s - before.time_s
        for before, after in pairwise(frames)
        if (after.counter - before.counter) % modulus == 1
    ]
    return float(np.median(steps)) if steps else None


def number(frames: Sequence[CountedFrame], *, period_s: float, modulus: int) -> Numbered:
    """Number the frames of one message.

    Args:
        frames: with right CRCs, in the order of reception.
        period_s: the sender's period on the log's clock, to a few per cent.
        modulus: after so many frames the counter begins again. More than half as many lost in a row show by the
            time alone.
    """
    placed: list[dict[int, CountedFrame]] = []
    duplicates = misplaced = 0
    last: tuple[int, CountedFrame] | None = None
    pending: CountedFrame | None = None
    for frame in frames:
        if last is None:
            placed.append({0: frame})
            last = (0, frame)
            continue
        step = _step(last[1], frame, period_s, modulus)
        if step is not None:
            misplaced += pending is not None
            pending = None
            index = last[0] + step
            if index in placed[-1]:
                duplicates += 1
                continue
            placed[-1][index] = frame
            # A frame that was overtaken does not show where the sender is now.
            last = (index, frame) if step > 0 else last
            continue
        begun = None if pending is None else _step(pending, frame, period_s, modulus)
        if pending is None or begun is None or begun < 0:
            misplaced += pending is not None
            pending = frame
        elif begun == 0:
            duplicates += 1
        else:
            placed.append({0: pending, begun: frame})
            last, pending = (begun, frame), None
    misplaced += pending is not None
    stretches = (piece for group in placed for piece in _cut_at_jumps(_stretch(group), period_s))
    return Numbered(stretches=tuple(stretches), duplicates=duplicates, misplaced=misplaced)


def _step(before: CountedFrame, after: CountedFrame, period_s: float, modulus: int) -> int | None:
    """Periods between two frames by the counters, nearest to those by the clock; None if they disagree or are many."""
    elapsed = (after.time_s - before.time_s) / period_s
    step = (after.counter - before.counter) % modulus
    step += modulus * round((elapsed - step) / modulus)
    return step if abs(step - elapsed) <= SLACK and step <= _LONGEST else None


def _stretch(group: dict[int, CountedFrame]) -> Stretch:
    index = np.array(sorted(group), dtype=np.intp)
    return Stretch(index=index - index[0], frames=tuple(group[k] for k in index.tolist()))


def _cut_at_jumps(stretch: Stretch, period_s: float) -> list[Stretch]:
    """The stretch, cut where times shift for good although each frame was within the slack of the one before."""
    late = stretch.time_s - period_s * stretch.index
    cuts, after = [0], 0
    for i in (np.flatnonzero(np.abs(np.diff(late)) > _JUMP * period_s) + 1).tolist():
        if i < after:
            continue
        here, there = late[max(cuts[-1], i - _AROUND) : i], late[i : i + _AROUND]
        if abs(np.median(there) - np.median(here)) > _JUMP * period_s:
            cuts.append(i)
            after = i + _AROUND // 2
    edges = [*cuts, len(stretch)]
    return [
        Stretch(index=stretch.index[a:b] - stretch.index[a], frames=stretch.frames[a:b]) for a, b in pairwise(edges)
    ]
