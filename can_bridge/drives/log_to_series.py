"""A recorded drive as series: pressures and actions, one row for each control period, and a report of missing data.

A short gap is interpolated linearly. A long gap ends a piece, because an episode is one uninterrupted recording.

If the log has the vehicle's speed, each row's coefficients are computed from this speed. If the recorded rows are not a
control period apart in convective time, new rows are interpolated from them, as in the ECU's window.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import can
import numpy as np

from can_bridge.drives.counted_frames import number, usual_interval, without_repeats
from can_bridge.drives.log_frames import frames_of
from can_bridge.drives.log_periods import Scales, SenderClock, clock_of, coefficients_of, samples_of, table_of
from can_bridge.drives.log_pieces import SHORTEST_PIECE, Cutter, Piece, resampled
from can_bridge.drives.vehicle_speed import Travel, VehicleSpeeds, vehicle_speeds
from can_bridge.e2e.profiles import profile_of
from can_bridge.secoc.key import Key
from can_bridge.wire.message_sets import MessageSet
from contract.arrays import Array, Mask
from contract.config.operating_point import OperatingPoint
from contract.errors import DatasetError

_DRIFT: Final = 1e-3
"""Largest relative difference between the sender's period and the control period, the same as for tables with times
(`contract.recording.findings`). Quartz clocks differ ten times less. Rows with a larger difference are resampled."""
_OUTSIDE: Final = 0.05
"""Largest relative difference between the control period and the nearest period that fits the log's speeds."""
_CONTRADICTS: Final = 0.01
"""Largest relative difference between a setting and the log. It is not 0, because the vehicle's value has an error."""
_STANDS: Final = 0.2
"""The vehicle counts as stationary if the distance in W from one row to the next is less than this share of
`flow.control_period`. The pressures of a stationary vehicle are as small as their resolution."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LogSeries:
    """The pieces of a log in the order of time, and a report of the data that were read or left out.

    Attributes:
        start_s: time in s of the log's first row, on the log's clock; `travel` is counted from this time.
        period_s: the sender's period in s on the log's clock.
        messages: name of the message set.
        speed: smallest, median (of the moving vehicle) and largest speed in m/s; None if the log has no speed.
        without_speed: number of rows in which the speed was unknown or the vehicle did not move.
        dynamic_pressure: dynamic pressure in Pa at the median speed.
        is_resampled: whether rows were interpolated between the log's rows, because the speed varies.
        frames: number of pressure frames and number of commands that were used.
        unused: numbers of frames that were not used, by the reason.
        lost: number of rows without a pressure frame and number of rows without a command, according to the counters.
        filled: number of rows with interpolated pressures and number of rows with an interpolated action.
        stale: number of frames that were sent a period or more after their pressures were sampled.
        drift: relative difference between the sender's period, measured on the log's clock, and its nominal value.
        jitter_s: largest difference in s between the time of a pressure frame and its row's time.
        gaps: a line of text for each gap, with times in s after the log's first pressure.
        checked: whether authentication codes were checked; None for messages without such codes.
    """

    pieces: tuple[Piece, ...]
    start_s: float
    travel: Travel
    period_s: float
    messages: str
    channel: str
    speed: tuple[float, float, float] | None
    without_speed: int
    dynamic_pressure: float
    is_resampled: bool
    frames: tuple[int, int]
    unused: Mapping[str, int]
    lost: tuple[int, int]
    filled: tuple[int, int]
    stale: int
    drift: float
    jitter_s: float
    gaps: tuple[str, ...]
    checked: bool | None


def series_of(
    path: Path,
    messages: Iterable[can.Message],
    scales: Scales,
    *,
    fill: int,
    split: bool,
    sensors: Sequence[str] = ("0", "1", "2", "3"),
    only: MessageSet | None = None,
    key: Key | None = None,
) -> LogSeries:
    """Return a drive's series. Raises DatasetError if the log lacks data, has a wrong period, or has a gap longer than
    `fill` and `split` is false; with `split`, such a gap divides the drive. `fill` is the longest gap that is filled,
    in control periods. For `only` and `key` see `frames_of`."""
    log = frames_of(path, messages, only=only, key=key, back_s=scales.period_s)
    modulus = profile_of(log.messages.pressure.spec).counter_period
    command_modulus = profile_of(log.messages.command.spec).counter_period
    speeds = vehicle_speeds(log.speeds, log.messages, scales.believed)
    if (interval_s := usual_interval(log.pressures, modulus)) is None:
        raise DatasetError(f"{path}: no two pressure frames are consecutive: frames between them are missing")
    if interval_s <= 0.0:
        raise DatasetError(f"{path}: most pressure frames are not later than the one before; the times are too coarse")
    nominal_s, point = scales.period_s if speeds is None else _nominal(interval_s), scales.point
    if speeds is None and abs(interval_s / scales.period_s - 1.0) > 0.2:
        raise DatasetError(
            f"{path}: its pressures are {interval_s * 1e3:.4g} ms apart, but the control period is "
            f"{scales.period_s * 1e3:.4g} ms, which is flow.control_period times W / U_inf: give the drive's "
            f"operating_point.width and .speed with --set"
        )
    stretches, repeated, misplaced = number(log.pressures, period_s=nominal_s, modulus=modulus)
    pressures, sampled_s, stale = zip(*(samples_of(one, log.messages, nominal_s) for one in stretches), strict=True)
    # The sender's period on the log's clock is found by a fit to the longest `FrameStretch`, if it is long enough.
    period_s = nominal_s
    longest = max(range(len(stretches)), key=lambda i: len(stretches[i]))
    if (rows := len(stretches[longest])) >= SHORTEST_PIECE:
        period_s, jitter_s = clock_of(stretches[longest], sampled_s[longest])[1:]
        drift = period_s / nominal_s - 1.0
        # Jitter at the two ends of a log looks like drift, so a shorter log may have a larger difference.
        uncertain = _DRIFT + jitter_s / (nominal_s * rows / 2)
        if speeds is not None:
            # The fitted period replaces the median interval, which jitter changes more.
            nominal_s = _nominal(period_s, uncertain)
        elif abs(drift) > uncertain:
            raise DatasetError(
                f"{path}: pressures come every {period_s * 1e3:.6g} ms, but the control period is "
                f"{nominal_s * 1e3:.6g} ms: {drift:+.2%} is too large for a clock drift; correct "
                f"flow.control_period or operating_point"
            )
    if speeds is not None:
        point = _point_of(path, speeds, nominal_s, scales)
    clocks = [clock_of(one, times, period_s) for one, times in zip(stretches, sampled_s, strict=True)]
    pace, start_s = period_s / nominal_s, clocks[0].start_s
    travel = Travel.steady(start_s, point.convective_time * pace)
    if speeds is not None:
        travel = speeds.travel(point.width, start_s, pace)
    commands = without_repeats(log.commands, command_modulus * nominal_s / 2)
    begins = [stretch.frames[0].time_s for stretch in stretches]
    cutter = Cutter(path, fill, split, sensors, begins[0], period_s)
    lost, without_speed = [0, 0], 0
    for i, (stretch, clock) in enumerate(zip(stretches, clocks, strict=True)):
        until = begins[i + 1] if i + 1 < len(begins) else np.inf
        here = [one for one in commands if begins[i] - period_s <= one.time_s < until]
        table = table_of(stretch, pressures[i], here, log.messages, clock, modulus)
        lost[0] += len(table) - 1 - len(stretch)
        lost[1] += int(np.isnan(table[1:, -1]).sum())
        speed, density = _air(speeds, clock, len(table), nominal_s, replace(scales, point=point))
        without_speed += int(np.isnan(speed[1:]).sum())
        table, moves = coefficients_of(table, speed, density, scales), np.isfinite(speed)
        if i > 0:
            cutter.restart(stretches[i - 1].frames[-1].time_s, begins[i])
        cutter.add(table, clock, moves)
    if not cutter.pieces:
        dead = [name for name, valid in zip(sensors, cutter.ever_valid, strict=True) if not valid]
        raise DatasetError(
            f"{path}: no part of it has {SHORTEST_PIECE} control periods in a row with valid pressures and commands; "
            f"it has {len(log.pressures)} pressures and {len(log.commands)} commands"
            + (f", and {without_speed} rows without the speed of a moving vehicle" if without_speed else "")
            + (f"; sensors that are never valid: {', '.join(dead)}" if dead else "")
        )
    pieces, is_resampled = cutter.pieces, False
    if speeds is not None:
        steps = np.concatenate([np.diff(travel.at(piece.time_s)) for piece in pieces])
        if is_resampled := bool(np.abs(steps / scales.period - 1.0).max() > _DRIFT):
            pieces = [resampled(piece, travel, scales.period) for piece in pieces]
    unused = {
        "damaged": log.damaged,
        "not authentic": log.forged,
        "repeated": repeated + len(log.commands) - len(commands),
        "out of sequence": misplaced,
        "with a repeated speed, or an impossible change of speed": 0 if speeds is None else speeds.left_out,
        **log.others,
    }
    return LogSeries(
        pieces=tuple(pieces),
        start_s=start_s,
        travel=travel,
        period_s=period_s,
        messages=log.messages.name,
        channel=log.channel,
        speed=None if speeds is None else (speeds.speed.min(), point.speed, speeds.speed.max()),
        without_speed=without_speed,
        dynamic_pressure=point.dynamic_pressure,
        is_resampled=is_resampled,
        frames=(sum(map(len, stretches)), len(commands)),
        unused={reason: count for reason, count in unused.items() if count},
        lost=(lost[0], lost[1]),
        filled=(cutter.filled[0], cutter.filled[1]),
        stale=sum(stale),
        drift=pace - 1.0,
        jitter_s=max(clock.jitter_s for clock in clocks),
        gaps=tuple(cutter.lines),
        checked=(key is not None) if log.messages.pressure.spec.is_secured else None,
    )


def _nominal(period_s: float, within: float = _DRIFT) -> float:
    """Return the sender's period in s on the sender's clock: the nearest multiple of 0.1 ms, if the period on the log's
    clock has at most the relative difference `within` from it; otherwise the two clocks count as equal."""
    rounded = round(period_s, 4)
    return rounded if abs(rounded - period_s) <= within * period_s else period_s


def _point_of(path: Path, speeds: VehicleSpeeds, period_s: float, scales: Scales) -> OperatingPoint:
    """Return the operating point with the log's median density and median speed while the vehicle moves. Raises
    DatasetError if the vehicle never moves, a given setting contradicts the log, or no speed fits the period."""
    moving = speeds.speed[_moves(speeds.speed, period_s, scales)]
    if not len(moving):  # the vehicle stands still, or the control period is that of another vehicle
        moving = speeds.speed[speeds.speed > 0.0]
    if not len(moving):
        raise DatasetError(f"{path}: its VehicleSpeed frames state 0 m/s: the vehicle stands still, so Cp is undefined")
    median, known = float(np.median(moving)), speeds.density[np.isfinite(speeds.density)]
    for name, values, unit in (("speed", moving, "m/s"), ("density", known, "kg/m3")):
        setting = float(getattr(scales.point, name))
        if f"operating_point.{name}" not in scales.given or not len(values):
            continue
        if not values.min() * (1 - _CONTRADICTS) <= setting <= values.max() * (1 + _CONTRADICTS):
            raise DatasetError(
                f"{path}: operating_point.{name} = {setting:g} {unit}, but its VehicleSpeed frames state "
                f"{float(np.median(values)):g} {unit}: leave the setting out; Cp is computed with the log's value"
            )
    point = replace(scales.point, speed=median, density=float(np.median(known)) if len(known) else scales.point.density)
    step = period_s / point.width
    slow, usual, fast = speeds.speed.min() * step, median * step, speeds.speed.max() * step
    if not slow * (1 - _OUTSIDE) <= scales.period <= fast * (1 + _OUTSIDE):
        raise DatasetError(
            f"{path}: its pressures are {period_s * 1e3:.4g} ms apart, and at the {median:g} m/s of its VehicleSpeed "
            f"frames this is a control period of {usual:.4g} W / U_inf, but flow.control_period is {scales.period:g} "
            f"(at the {scales.point.speed:g} m/s of operating_point.speed, the period would be "
            f"{period_s / scales.point.convective_time:.4g}): give --set flow.control_period={usual:.4g}"
        )
    return point


def _air(
    speeds: VehicleSpeeds | None, clock: SenderClock, rows: int, nominal_s: float, scales: Scales
) -> tuple[Array, Array]:
    """Return each row's speed in m/s and air density in kg/m3. An unknown or stationary vehicle's speed is NaN."""
    point = scales.point
    if speeds is None:
        return np.full(rows, point.speed), np.full(rows, point.density)
    speed, density = speeds.at(clock.start_s + clock.period_s * (np.arange(rows, dtype=np.float64) - 1.0))
    moves = _moves(speed, nominal_s, scales)
    return np.where(moves, speed, np.nan), np.where(np.isnan(density), point.density, density)


def _moves(speed: Array, period_s: float, scales: Scales) -> Mask:
    return np.asarray(speed * period_s / scales.point.width >= _STANDS * scales.period)
