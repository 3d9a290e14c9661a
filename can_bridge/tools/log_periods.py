"""From numbered pressures and the commands that answer them to one row a control period, gaps filled or named.

Row k has the pressures of frame k and the action commanded for them: the first command that echoes frame k's counter.
Commands that rest on an older frame, because the ECU held or shut the jets when one was missing, belong to the period
in which they came.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from can_bridge.tools.counted_frames import CountedFrame, Stretch
from can_bridge.wire.message_sets import MessageSet
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import SENSORS, Mode
from contract.arrays import Array, Mask

_HELD: Final = (Mode.HOLD, Mode.DECAY, Mode.FAULT)
"""Modes whose commands do not answer the frame that they echo."""
_UNKNOWN_LAG: Final = 0.5
"""Of a period, from pressure to command, where no command echoes a pressure."""


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
        stale: rows whose pressures were older than a period when they were sent; they count as missing.
    """

    Cp: Array
    action: Array
    before: float | None
    stale: int


def clock_of(stretch: Stretch, ages_s: Array, period_s: float | None = None) -> Clock:
    """The line through the times of sampling, by medians, so that single late frames do not move it.

    Args:
        ages_s: from sampling to sending, (n,).
        period_s: of the sender, if it is known better than this stretch tells.
    """
    sampled, index = stretch.time_s - ages_s, stretch.index.astype(np.float64)
    if period_s is None:
        # Theil and Sen's slope over pairs half the stretch apart, which weigh most.
        half = len(stretch) // 2
        period_s = float(np.median((sampled[half:] - sampled[:-half]) / (index[half:] - index[:-half])))
    late = sampled - period_s * index
    start = float(np.median(late))
    return Clock(start_s=start, period_s=period_s, jitter_s=float(np.abs(late - start).max()))


def ages_of(stretch: Stretch, messages: MessageSet, period_s: float) -> Array:
    """From sampling to sending in s, (n,); 0 where it is a period or more, which tells of no one row."""
    parsed = (messages.pressure.parse(frame.data) for frame in stretch.frames)
    ages = np.array([0.0 if one is None else one.age_ns * 1e-9 for one in parsed])
    return np.where(ages < period_s, ages, 0.0)


def rows_of(
    stretch: Stretch, commands: Sequence[CountedFrame], messages: MessageSet, scales: Scales, clock: Clock, modulus: int
) -> Rows:
    """One row a period from the stretch's first frame to its last.

    Args:
        commands: those that came during the stretch, without repeated ones.
        modulus: of the pressures' counter.
    """
    count = int(stretch.index[-1]) + 1
    cp = np.full((count, SENSORS), np.nan)
    stale = 0
    for k, frame in zip(stretch.index.tolist(), stretch.frames, strict=True):
        message = messages.pressure.parse(frame.data)
        if message is None:
            continue
        if message.age_ns * 1e-9 >= scales.period_s:
            stale += 1
            continue
        cp[k] = np.where(message.valid, np.array(message.pressure_pa) / scales.dynamic_pressure, np.nan)
    actions = _actions(stretch.frames[0].counter, count, commands, messages, scales, clock, modulus)
    return Rows(
        Cp=cp,
        action=np.array([actions.get(k, np.nan) for k in range(count)]),
        before=actions.get(-1),
        stale=stale,
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
    others: list[tuple[float, float]] = []
    for frame in commands:
        command = messages.command.parse(frame.data)
        if command is None:
            continue
        at = clock.row_at(frame.time_s)
        action = _action(command.flow_m2_per_s if command.enable else 0.0, scales)
        if command.pressure_counter is None or command.mode in _HELD:
            others.append((at, action))
            continue
        newest = int(np.floor(at + 0.5))
        k = newest - (first_counter + newest - command.pressure_counter) % modulus
        if k in actions or not -1 <= k < count:
            others.append((at, action))
            continue
        actions[k] = action
        lags.append(at - k)
    lag = float(np.median(lags)) if lags else _UNKNOWN_LAG
    for at, action in others:
        k = round(at - lag)
        if -1 <= k < count:
            actions.setdefault(k, action)
    return actions


def _action(flow: float, scales: Scales) -> float:
    action, limit = flow / scales.flow_rate, scales.action_limit
    # Half a step of the wire, and as little more as a sum's rounding makes.
    half = 0.5001 * FLOW_RESOLUTION_M2_PER_S / scales.flow_rate
    return float(np.clip(action, -limit, limit)) if abs(action) <= limit + half else action


def runs(missing: Mask) -> list[tuple[int, int]]:
    """First and one past the last of every run of True in (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def filled(values: Array) -> Array:
    """A series (n,) with NaN replaced on the straight line between its neighbours, which must be there."""
    known = np.isfinite(values)
    at = np.arange(len(values))
    return np.asarray(np.interp(at, at[known], values[known]))
