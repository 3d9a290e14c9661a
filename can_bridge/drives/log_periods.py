"""From numbered pressures and the commands that answer them to one row a control period, gaps filled or named.

Row k has the pressures of frame k and the action commanded for them: the first command that echoes frame k's counter.
Commands that rest on an older frame, because the ECU held or shut the jets when one was missing, belong to the period
in which they came. A command for the next period is the action of the row after.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from can_bridge.drives.counted_frames import CountedFrame, Stretch
from can_bridge.wire.message_sets import MessageSet
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import SENSORS, Mode
from contract.arrays import Array, Mask

_HELD: Final = (Mode.HOLD, Mode.DECAY, Mode.FAULT)
"""Modes whose commands do not answer the frame that they echo."""
_UNKNOWN_LAG: Final = 0.5
"""The share of a period from pressure to command, where no command echoes a pressure."""


@dataclass(frozen=True, kw_only=True)
class Scales:
    """From the wire's units to those of a data set.

    Attributes:
        period_s: control period in s.
        dynamic_pressure: rho U_inf^2 / 2 in Pa.
        flow_rate: U_inf W in m2/s.
        action_limit: in U_inf W; a command beyond it by half a step of the wire is the limit, rounded.
    """

    period_s: float
    dynamic_pressure: float
    flow_rate: float
    action_limit: float


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Where the sender's periods lie on the log's clock.

    Attributes:
        start_s: of row 0, the median over all rows: half of the frames came later than row k's time.
        period_s: of the sender, as the log's clock sees it.
        jitter_s: largest distance of a frame from its row's time.
    """

    start_s: float
    period_s: float
    jitter_s: float

    def row_at(self, time_s: float) -> float:
        """The row at that time, and the share of the period since."""
        return (time_s - self.start_s) / self.period_s


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Rows of one stretch; NaN where the log has nothing.

    Attributes:
        Cp: (n, 4).
        action: (n,).
        before: the action of the row before the first; None if the log does not have it.
    """

    Cp: Array
    action: Array
    before: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """The contents of the pressure frames of a stretch.

    Attributes:
        pressure_pa: NaN where a sensor was not valid, or all were too old, (n, 4).
        sampled_s: when they were sampled on the log's clock, (n,).
        stale: frames whose pressures were a period old or older when they were sent: of no one row.
    """

    pressure_pa: Array
    sampled_s: Array
    stale: int


def samples_of(stretch: Stretch, messages: MessageSet, period_s: float) -> Samples:
    """The frames' contents; what cannot be parsed is NaN."""
    parsed = [messages.pressure.parse(frame.data) for frame in stretch.frames]
    none = (np.nan,) * SENSORS
    pressure = np.array([none if one is None else one.pressure_pa for one in parsed])
    valid = np.array([(False,) * SENSORS if one is None else one.valid for one in parsed])
    age_s = np.array([0.0 if one is None else one.age_ns * 1e-9 for one in parsed])
    fresh = age_s < period_s
    return Samples(
        pressure_pa=np.where(valid & fresh[:, None], pressure, np.nan),
        sampled_s=stretch.time_s - np.where(fresh, age_s, 0.0),
        stale=int((~fresh).sum()),
    )


def clock_of(stretch: Stretch, sampled_s: Array, period_s: float | None = None) -> Clock:
    """The line through the times of sampling, by medians, so that single late frames do not move it.

    Args:
        sampled_s: times of sampling, (n,).
        period_s: of the sender, if it is known better than from this stretch.
    """
    index = stretch.index.astype(np.float64)
    if period_s is None:
        # Theil and Sen's slope over pairs half the stretch apart, which weigh most.
        half = len(stretch) // 2
        period_s = float(np.median((sampled_s[half:] - sampled_s[:-half]) / (index[half:] - index[:-half])))
    late = sampled_s - period_s * index
    start = float(np.median(late))
    return Clock(start_s=start, period_s=period_s, jitter_s=float(np.abs(late - start).max()))


def rows_of(
    stretch: Stretch,
    samples: Samples,
    commands: Sequence[CountedFrame],
    messages: MessageSet,
    scales: Scales,
    clock: Clock,
    modulus: int,
) -> Rows:
    """One row a period from the stretch's first frame to its last.

    Args:
        commands: those that came during the stretch, without repeated ones.
        modulus: of the pressures' counter.
    """
    count = int(stretch.index[-1]) + 1
    cp = np.full((count, SENSORS), np.nan)
    cp[stretch.index] = samples.pressure_pa / scales.dynamic_pressure
    actions = _actions(stretch.frames[0].counter, count, commands, messages, scales, clock, modulus)
    return Rows(
        Cp=cp,
        action=np.array([actions.get(k, np.nan) for k in range(count)]),
        before=actions.get(-1),
    )


def _actions(
    first_counter: int,
    count: int,
    commands: Sequence[CountedFrame],
    messages: MessageSet,
    scales: Scales,
    clock: Clock,
    modulus: int,
) -> dict[int, float]:
    """Actions by row, from -1 on."""
    actions: dict[int, float] = {}
    lags: list[float] = []
    others: list[tuple[float, float, int]] = []
    for frame in commands:
        command = messages.command.parse(frame.data)
        if command is None:
            continue
        at = clock.row_at(frame.time_s)
        action = _action(command.flow_m2_per_s if command.enable else 0.0, scales)
        if command.pressure_counter is None or command.mode in _HELD:
            others.append((at, action, command.next_period))
            continue
        newest = math.floor(at + 0.5)
        answered = newest - (first_counter + newest - command.pressure_counter) % modulus
        k = answered + command.next_period
        if k in actions or not -1 <= k < count:
            others.append((at, action, command.next_period))
            continue
        actions[k] = action
        lags.append(at - answered)
    lag = float(np.median(lags)) if lags else _UNKNOWN_LAG
    for at, action, later in others:
        k = round(at - lag) + later
        if -1 <= k < count:
            actions.setdefault(k, action)
    return actions


def _action(flow: float, scales: Scales) -> float:
    action, limit = flow / scales.flow_rate, scales.action_limit
    # Half a step of the wire, and as little more as a sum's rounding makes.
    half = 0.5001 * FLOW_RESOLUTION_M2_PER_S / scales.flow_rate
    return max(-limit, min(limit, action)) if abs(action) <= limit + half else action


def runs(missing: Mask) -> list[tuple[int, int]]:
    """First and one past the last of every run of True in (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def filled(values: Array) -> Array:
    """A series (n,) with NaN replaced on the straight line between its neighbours, which must be there."""
    known = np.isfinite(values)
    at = np.arange(len(values))
    return np.asarray(np.interp(at, at[known], values[known]))
