"""The numbered pressures and the commands that answer them, as one row for each control period.

Row k has the pressures of frame k, and the action of the first command that echoes frame k's counter. A command may be
based on an older frame, because the ECU held its command or shut the jets when a frame was missing; such a command
belongs to the period in which it arrived. A command with the flag `next_period` is the action of row k + 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from can_bridge.drives.counted_frames import CountedFrame, FrameStretch
from can_bridge.wire.message_sets import MessageSet
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import SENSORS, Mode
from contract.arrays import Array
from contract.config.operating_point import OperatingPoint
from contract.config.vehicle import SpeedConfig

_HELD: Final = (Mode.HOLD, Mode.DECAY, Mode.FAULT)
"""Modes in which a command is not the answer to the frame whose counter the command echoes."""


@dataclass(frozen=True, kw_only=True)
class Scales:
    """The conversion from the messages' units to the units of a data set.

    Attributes:
        period: control period in W / U_inf.
        point: operating point. Its W is always used, its U_inf and rho only where the log does not state them.
        action_limit: bound on the action, in U_inf W; replaces an action above it by up to half the resolution.
        given: names of the operating point's settings that the user gave; the log must not contradict them.
    """

    period: float
    point: OperatingPoint
    action_limit: float
    given: frozenset[str] = frozenset()
    believed: SpeedConfig = field(default_factory=SpeedConfig)

    @property
    def period_s(self) -> float:
        return self.point.period_ns(self.period) * 1e-9


class SenderClock(NamedTuple):
    """The sender's periods on the log's clock.

    Attributes:
        start_s: time of row 0 in s; a median, so that half of the frames are later than the times of their rows.
        period_s: the sender's period in s.
        jitter_s: largest difference in s between the time of a frame and its row's time.
    """

    start_s: float
    period_s: float
    jitter_s: float


def samples_of(stretch: FrameStretch, messages: MessageSet, period_s: float) -> tuple[Array, Array, int]:
    """Return the pressures (n, 4) in Pa of the stretch's n frames, their sampling times (n,) in s on the log's clock,
    and the number of frames that were sent a period or more after the sampling. A pressure is NaN if its sensor was
    invalid, or if its frame was sent that late or cannot be parsed."""
    parsed = [messages.pressure.parse(frame.data) for frame in stretch.frames]
    pressure = np.array([(np.nan,) * SENSORS if one is None else one.pressure_pa for one in parsed])
    valid = np.array([(False,) * SENSORS if one is None else one.valid for one in parsed])
    age_s = np.array([0.0 if one is None else one.age_ns * 1e-9 for one in parsed])
    fresh = age_s < period_s
    pressure[~(valid & fresh[:, None])] = np.nan
    return pressure, stretch.time_s - np.where(fresh, age_s, 0.0), int((~fresh).sum())


def clock_of(stretch: FrameStretch, sampled_s: Array, period_s: float | None = None) -> SenderClock:
    """Fit a line to the n frames' sampling times, (n,). The fit uses medians, so that a few late frames do not change
    the line. If `period_s`, the sender's period in s, is None, it is fitted too."""
    index = stretch.index.astype(np.float64)
    if period_s is None:
        # The Theil-Sen slope, from pairs with half of the frames between them: closer pairs have larger errors.
        half = len(stretch) // 2
        period_s = float(np.median((sampled_s[half:] - sampled_s[:-half]) / (index[half:] - index[:-half])))
    late = sampled_s - period_s * index
    start = float(np.median(late))
    return SenderClock(start, period_s, float(np.abs(late - start).max()))


def table_of(
    stretch: FrameStretch,
    pressure_pa: Array,
    commands: Sequence[CountedFrame],
    messages: MessageSet,
    clock: SenderClock,
    modulus: int,
) -> Array:
    """Return the four pressures in Pa and the jets' flow in m2/s, one row for each period, (n + 1, 5). The first row is
    one period before the first frame, and the frames cover n periods. NaN means that the log has no value.

    `pressure_pa` has the pressures of the stretch's frames. `commands` has the commands received during the time of
    these frames, without repetitions. `modulus` is the number of values of the pressures' counter.
    """
    table = np.full((int(stretch.index[-1]) + 2, SENSORS + 1), np.nan)
    table[stretch.index + 1, :SENSORS] = pressure_pa
    action = table[:, SENSORS]
    parsed = [(one, frame.time_s) for frame in commands if (one := messages.command.parse(frame.data)) is not None]
    at = (np.array([time_s for _, time_s in parsed]) - clock.start_s) / clock.period_s
    asked = np.array([one.flow_m2_per_s if one.enable else 0.0 for one, _ in parsed])
    later = np.array([one.next_period for one, _ in parsed], dtype=np.intp)
    answers = np.array([one.pressure_counter is not None and one.mode not in _HELD for one, _ in parsed], np.bool_)
    echoed = np.array([one.pressure_counter or 0 for one, _ in parsed], dtype=np.intp)
    newest = np.floor(at + 0.5).astype(np.intp)
    answered = newest - (stretch.frames[0].counter + newest - echoed) % modulus
    # Row k has index k + 1 in the table, because the table begins one period before the first frame.
    place = answered + later + 1
    inside = np.flatnonzero(answers & (place >= 0) & (place < len(table)))
    first = inside[np.unique(place[inside], return_index=True)[1]]
    action[place[first]] = asked[first]
    # The time from a pressure frame to its command, in periods; it is unknown if no command echoes a frame's counter.
    lag = float(np.median(at[first] - answered[first])) if len(first) else 0.5
    for i in np.setdiff1d(np.arange(len(parsed)), first).tolist():
        k = round(at[i] - lag) + int(later[i]) + 1
        if 0 <= k < len(table) and np.isnan(action[k]):
            action[k] = asked[i]
    return table


def coefficients_of(table: Array, speed: Array | float, density: Array | float, scales: Scales) -> Array:
    """Return pressures and flows, (n, 5), converted to Cp and actions as in the ECU. `speed` of the vehicle in
    m/s and `density` of the air in kg/m3 have one value for each of the n rows, or one value for all rows."""
    scale = np.empty_like(table)
    scale[:, :SENSORS] = np.reshape(0.5 * np.asarray(density) * np.square(speed), (-1, 1))
    scale[:, SENSORS] = np.multiply(speed, scales.point.width)
    made = table / scale
    # An action may exceed the limit by half of the resolution, and by a little more because of rounding.
    action, limit = made[:, SENSORS], scales.action_limit
    half = 0.5001 * FLOW_RESOLUTION_M2_PER_S / scale[:, SENSORS]
    made[:, SENSORS] = np.where(np.abs(action) <= limit + half, np.clip(action, -limit, limit), action)
    return made
