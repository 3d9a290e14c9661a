"""The frames of one message in a log, numbered by their E2E counter, to find missing, repeated and misplaced frames.

A log's times are times of reception: a frame may have waited for other traffic, and loggers write in bursts. So frames
are numbered by their counter; the time only shows how often the counter has wrapped. A new `FrameStretch` begins after
a long gap, and where counter and time disagree permanently because the sender restarted or the logger's clock was set.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from contract.arrays import Array, Index

SLACK: Final = 2.0
"""Largest difference, in periods, between the time from one frame to the next and the time that the counters imply."""
_LONGEST: Final = 1000
"""Largest number of periods without a frame within a stretch. The limit prevents many empty rows if a clock was set."""
_JUMP: Final = 0.5
"""Largest permanent shift of the times within a stretch, in periods; at a larger shift a new stretch begins."""
_AROUND: Final = 16
"""Number of frames on each side of a shift, more than in a burst. Their median delays differ by the shift."""


class CountedFrame(NamedTuple):
    """A frame with a valid CRC. `time_s` is the time of reception on the log's clock."""

    time_s: float
    counter: int
    data: bytes


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameStretch:
    """The n frames of a sender between restarts. `index` counts control periods from the first, (n,), increasing."""

    index: Index
    frames: tuple[CountedFrame, ...]

    @property
    def time_s(self) -> Array:
        """The time of reception of each frame in s, (n,)."""
        return np.array([frame.time_s for frame in self.frames])

    def __len__(self) -> int:
        return len(self.frames)


def usual_interval(frames: Sequence[CountedFrame], modulus: int) -> float | None:
    """Return the median time in s between successive frames with consecutive counters; None without such frames."""
    times, counters = np.array([(frame.time_s, frame.counter) for frame in frames]).T
    steps = np.diff(times)[np.diff(counters) % modulus == 1]
    return float(np.median(steps)) if len(steps) else None


def without_repeats(frames: Sequence[CountedFrame], within_s: float) -> list[CountedFrame]:
    """Return the frames, except frames that repeat the data of a frame at most `within_s` before them."""
    kept: list[CountedFrame] = []
    last: dict[bytes, float] = {}
    for frame in frames:
        if abs(frame.time_s - last.get(frame.data, -np.inf)) > within_s:
            kept.append(frame)
        last[frame.data] = frame.time_s
    return kept


def number(frames: Sequence[CountedFrame], *, period_s: float, modulus: int) -> tuple[list[FrameStretch], int, int]:
    """Return the stretches of one message in the order of time, the number of repeated frames, and the number of
    misplaced frames. The counter of a misplaced frame fits neither the frames before it nor the frames after it.
    `period_s` is the sender's period on the log's clock in s, to a few per cent; the counter's period is `modulus`."""
    once = without_repeats(frames, SLACK * period_s)
    parts = _parts(once, period_s, modulus)
    # Misplaced frames are removed first, because the frames before and after a misplaced frame may be one stretch.
    fitting = [frame for part in parts if len(part) > 1 for _, frame in part] or once
    stretches: list[FrameStretch] = []
    for part in _parts(fitting, period_s, modulus):
        numbers, places = np.unique([k for k, _ in part], return_index=True)
        whole = FrameStretch(index=numbers - numbers[0], frames=tuple(part[k][1] for k in places.tolist()))
        stretches += _cut_at_jumps(whole, period_s)
    return stretches, len(frames) - len(once) + len(fitting) - sum(map(len, stretches)), len(once) - len(fitting)


def _parts(frames: Sequence[CountedFrame], period_s: float, modulus: int) -> list[list[tuple[int, CountedFrame]]]:
    """Number the frames; begin a new part where the counter and the clock disagree or many frames are missing."""
    parts: list[list[tuple[int, CountedFrame]]] = []
    newest, before = 0, None
    for frame in frames:
        elapsed = 0.0 if before is None else (frame.time_s - before.time_s) / period_s
        step = 0 if before is None else (frame.counter - before.counter) % modulus
        # The step is the number of periods nearest to the elapsed time among those that agree with the counters.
        step += modulus * round((elapsed - step) / modulus)
        if before is None or abs(step - elapsed) > SLACK or step > _LONGEST:
            parts.append([(0, frame)])
            newest, before = 0, frame
            continue
        parts[-1].append((newest + step, frame))
        # If the previous frame overtook this one, the next is compared with the previous one, whose counter is later.
        if step > 0:
            newest, before = newest + step, frame
    return parts


def _cut_at_jumps(stretch: FrameStretch, period_s: float) -> list[FrameStretch]:
    """Cut the stretch where its times shift permanently by more than `_JUMP`; single shifts are at most `SLACK`."""
    late = stretch.time_s - period_s * stretch.index
    cuts, after = [0], 0
    for i in (np.flatnonzero(np.abs(np.diff(late)) > _JUMP * period_s) + 1).tolist():
        here, there = late[max(cuts[-1], i - _AROUND) : i], late[i : i + _AROUND]
        if i >= after and abs(np.median(there) - np.median(here)) > _JUMP * period_s:
            cuts.append(i)
            after = i + _AROUND // 2
    index, frames = stretch.index, stretch.frames
    return [FrameStretch(index=index[a:b] - index[a], frames=frames[a:b]) for a, b in pairwise([*cuts, len(frames)])]
