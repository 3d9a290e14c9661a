"""A recorded drive as series: pressures and actions, one row a control period, and a report of what is missing.

A short gap is filled on the straight line between its neighbours. A long one ends a piece: an episode of a data set is
one uninterrupted recording. Whether a log may have more than one piece is the caller's choice.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import can
import numpy as np

from can_bridge.drives.counted_frames import number, usual_interval, without_repeats
from can_bridge.drives.log_frames import Verify, frames_of
from can_bridge.drives.log_periods import Clock, Scales, clock_of, samples_of, table_of
from can_bridge.drives.log_pieces import SHORTEST, Cutter, Piece
from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.message_sets import MessageSet
from contract.errors import DatasetError

_OTHER_PERIOD: Final = 0.2
"""Share by which neighbouring frames may be nearer or further than a period at the median: jitter, no other period."""
_DRIFT: Final = 1e-3
"""Share by which the sender's period may differ from the control period, as in a table with times
(`contract.recording.findings`); quartz clocks differ by a tenth of it at most."""


@dataclass(frozen=True, kw_only=True)
class LogReport:
    """What was read, and what was made of the rest.

    Attributes:
        messages: name of the set of messages.
        frames: pressures and commands used.
        unused: frames that were not, by the reason in words.
        lost: rows without a pressure frame, and rows without a command; known by the counters.
        filled: values that stand on a straight line: rows with one or more filled pressures, rows with a filled action.
        stale: frames whose pressures were older than a period when they were sent.
        drift: how much longer the sender's period is on the log's clock than the control period, as a share.
        jitter_s: largest distance of a pressure frame from its row's time.
        gaps: one line each for what was filled, cut or left out.
        checked: whether authentication codes were; None for messages without.
    """

    messages: str
    frames: tuple[int, int]
    unused: Mapping[str, int]
    lost: tuple[int, int]
    filled: tuple[int, int]
    stale: int
    drift: float
    jitter_s: float
    gaps: tuple[str, ...]
    checked: bool | None


@dataclass(frozen=True, kw_only=True, eq=False)
class LogSeries:
    """A log's pieces in the order of time, the time of its first row on the log's clock, and the report."""

    pieces: tuple[Piece, ...]
    start_s: float
    period_s: float
    report: LogReport


def series_of(
    path: Path,
    messages: Iterable[can.Message],
    scales: Scales,
    *,
    fill: int,
    split: bool,
    sensors: Sequence[str] = ("0", "1", "2", "3"),
    only: MessageSet | None = None,
    verify: Verify | None = None,
) -> LogSeries:
    """A drive's series. Raises DatasetError if the log does not have what is needed, has another period, or has a long
    gap and `split` is false.

    Args:
        messages: of the log, in its order.
        scales: operating point and control period.
        fill: longest gap in control periods that is filled.
        split: whether a longer gap makes two pieces; it is refused otherwise.
        sensors: names of the pressures, for the report.
        only: the set of messages to read; without one, the set that the log has pressures of.
        verify: of secured messages; without it, freshness and authentication codes are not looked at.
    """
    log = frames_of(path, messages, only=only, verify=verify, back_s=scales.period_s)
    modulus, command_modulus = (
        profile_of(one.spec).counter_period for one in (log.messages.pressure, log.messages.command)
    )
    _check_period(path, usual_interval(log.pressures, modulus), scales)
    stretches, repeated, misplaced = number(log.pressures, period_s=scales.period_s, modulus=modulus)
    samples = [samples_of(one, log.messages, scales.period_s) for one in stretches]
    # The sender's period on the log's clock, by the longest stretch; the control period where that is too short.
    period_s = scales.period_s
    longest = max(range(len(stretches)), key=lambda i: len(stretches[i]))
    if len(stretches[longest]) >= SHORTEST:
        clock = clock_of(stretches[longest], samples[longest].sampled_s)
        _check_drift(path, clock, len(stretches[longest]), scales)
        period_s = clock.period_s
    clocks = [clock_of(a, b.sampled_s, period_s) for a, b in zip(stretches, samples, strict=True)]
    commands = without_repeats(log.commands, command_modulus * scales.period_s / 2)
    begins = [stretch.frames[0].time_s for stretch in stretches]
    cutter = Cutter(path, fill, split, sensors, begins[0], period_s)
    lost = [0, 0]
    for i, (stretch, clock) in enumerate(zip(stretches, clocks, strict=True)):
        until = begins[i + 1] if i + 1 < len(begins) else np.inf
        here = [one for one in commands if begins[i] - period_s <= one.time_s < until]
        table = table_of(stretch, samples[i].pressure_pa, here, log.messages, scales, clock, modulus)
        lost[0] += len(table) - 1 - len(stretch)
        lost[1] += int(np.isnan(table[1:, -1]).sum())
        if i > 0:
            cutter.restart(stretches[i - 1].frames[-1].time_s, begins[i])
        cutter.add(table, clock)
    if not cutter.pieces:
        dead = [name for name, valid in zip(sensors, cutter.ever_valid, strict=True) if not valid]
        raise DatasetError(
            f"{path}: no part of it has {SHORTEST} control periods in a row with valid pressures and commands; it has "
            f"{len(log.pressures)} pressures and {len(log.commands)} commands"
            + (f", and {', '.join(dead)} valid in none" if dead else "")
        )
    unused = {
        "damaged": log.damaged,
        "not authentic": log.forged,
        "repeated": repeated + len(log.commands) - len(commands),
        "out of sequence": misplaced,
        "of other messages": log.foreign,
    }
    report = LogReport(
        messages=log.messages.name,
        frames=(sum(map(len, stretches)), len(commands)),
        unused={reason: count for reason, count in unused.items() if count},
        lost=(lost[0], lost[1]),
        filled=(cutter.filled[0], cutter.filled[1]),
        stale=sum(one.stale for one in samples),
        drift=period_s / scales.period_s - 1.0,
        jitter_s=max(clock.jitter_s for clock in clocks),
        gaps=tuple(cutter.lines),
        checked=(verify is not None) if log.messages.pressure.spec.is_secured else None,
    )
    return LogSeries(pieces=tuple(cutter.pieces), start_s=clocks[0].start_s, period_s=period_s, report=report)


def _check_period(path: Path, interval_s: float | None, scales: Scales) -> None:
    if interval_s is None:
        raise DatasetError(f"{path}: no two of its pressures follow each other: every other frame is missing")
    if abs(interval_s / scales.period_s - 1.0) > _OTHER_PERIOD:
        raise DatasetError(
            f"{path}: its pressures are {interval_s * 1e3:.4g} ms apart, the control period is "
            f"{scales.period_s * 1e3:.4g} ms; it is --period times W / U_inf: give the drive's operating_point.width "
            f"and .speed with --config or --set"
        )


def _check_drift(path: Path, clock: Clock, rows: int, scales: Scales) -> None:
    drift = clock.period_s / scales.period_s - 1.0
    # Jitter of one end against the other shows as drift, the less the longer the log is.
    if abs(drift) > _DRIFT + clock.jitter_s / (scales.period_s * rows / 2):
        raise DatasetError(
            f"{path}: its pressures come every {clock.period_s * 1e3:.6g} ms, the control period is "
            f"{scales.period_s * 1e3:.6g} ms: {drift:+.2%}, more than clocks differ; put --period or operating_point "
            f"right"
        )
