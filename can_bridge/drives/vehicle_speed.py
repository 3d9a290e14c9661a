"""The vehicle's speed in the frames of a drive, to convert pressures to Cp and seconds to convective times.

The speed is checked as in the ECU (`ecu.speed_reception`): a speed that needs an impossible acceleration is left out;
the last valid speed then stays in use for a limited time. Between two valid speeds the speed is interpolated linearly.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from can_bridge.drives.counted_frames import CountedFrame
from can_bridge.wire.message_sets import MessageSet
from contract.arrays import Array
from contract.config.vehicle import SpeedConfig


@dataclass(frozen=True, kw_only=True, eq=False)
class VehicleSpeeds:
    """The n valid speeds in the frames of a log, in m/s, (n,).

    Attributes:
        time_s: times of measurement in s on the log's clock, increasing, (n,).
        density: density of the air in kg/m3, (n,); NaN if the vehicle does not state it.
        oldest_s: longest time in s for which a speed is used before and after its measurement.
        left_out: number of speeds in the frames that are implausible or repeated.
    """

    time_s: Array
    speed: Array
    density: Array
    oldest_s: float
    left_out: int

    def at(self, time_s: Array) -> tuple[Array, Array]:
        """Return speed and density at m times, (m,); the speed is NaN more than `oldest_s` from every valid speed."""
        behind = np.clip(np.searchsorted(self.time_s, time_s), 1, len(self.time_s) - 1) if len(self.time_s) > 1 else 0
        nearest = np.minimum(np.abs(time_s - self.time_s[behind]), np.abs(time_s - self.time_s[behind - 1]))
        speed = np.interp(time_s, self.time_s, self.speed)
        return np.where(nearest <= self.oldest_s, speed, np.nan), np.interp(time_s, self.time_s, self.density)

    def travel(self, width: float, start_s: float, pace: float) -> "Travel":
        """Return the distance travelled in body lengths since the time `start_s` on the log's clock. `pace` is the
        speed of the log's clock relative to the sender's clock."""
        # The distance travelled must increase even if the vehicle stands still.
        speed = np.maximum(self.speed, 1e-3) / (width * pace)
        if len(speed) == 1:
            return Travel.steady(start_s, 1.0 / float(speed[0]))
        way = np.concatenate([[0.0], np.cumsum(np.diff(self.time_s) * (speed[1:] + speed[:-1]) / 2)])
        travel = Travel(time_s=self.time_s, way=way)
        return Travel(time_s=self.time_s, way=way - travel.at(np.array([start_s]))[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Travel:
    """The distance travelled in body lengths W at n times in s, both increasing, (n,). Straight lines connect and
    extend these points. The distance in W equals the time in W / U_inf for every U_inf."""

    time_s: Array
    way: Array

    @classmethod
    def steady(cls, start_s: float, convective_time: float) -> "Travel":
        """Return the distance travelled since `start_s`, if a body length takes `convective_time` s."""
        return cls(time_s=np.array([start_s, start_s + convective_time]), way=np.array([0.0, 1.0]))

    def at(self, time_s: Array) -> Array:
        """Return the distances travelled up to the given times."""
        return _line(time_s, self.time_s, self.way)

    def time(self, way: Array) -> Array:
        return _line(way, self.way, self.time_s)


def _line(wanted: Array, x: Array, y: Array) -> Array:
    inside = np.interp(wanted, x, y)
    below, above = (y[1] - y[0]) / (x[1] - x[0]), (y[-1] - y[-2]) / (x[-1] - x[-2])
    return np.asarray(inside + np.minimum(wanted - x[0], 0.0) * below + np.maximum(wanted - x[-1], 0.0) * above)


def vehicle_speeds(frames: Sequence[CountedFrame], messages: MessageSet, config: SpeedConfig) -> VehicleSpeeds | None:
    """Return the valid speeds; None if no frame has a valid speed. The speeds are grouped into spans without a jump.
    Spans shorter than `config.oldest_ms` are left out, unless all spans are so short."""
    oldest_s = config.oldest_ms * 1e-3
    said = []
    for frame in frames:
        value = messages.speed.parse(frame.data)
        if value is not None and value.speed_m_per_s is not None and value.age_ns * 1e-9 <= oldest_s:
            density = np.nan if value.density_kg_per_m3 is None else value.density_kg_per_m3
            said.append((frame.time_s - value.age_ns * 1e-9, value.speed_m_per_s, density))
    count, spans = len(said), _spans(said, config)
    for _ in range(10):  # a wrong first speed makes correct ones look wrong
        if len(spans) > 1 and spans[0][-1][0] - spans[0][0][0] < oldest_s:
            said = said[len(spans[0]) :]
            spans = _spans(said, config)
    long = [span for span in spans if span[-1][0] - span[0][0] >= oldest_s] or spans
    if not long:
        return None
    time, speeds, densities = np.array([one for span in long for one in span]).T
    return VehicleSpeeds(time_s=time, speed=speeds, density=densities, oldest_s=oldest_s, left_out=count - len(time))


def _spans(said: list[tuple[float, float, float]], config: SpeedConfig) -> list[list[tuple[float, float, float]]]:
    """Group triples of time, speed and density into spans. A triple is left out if its speed would need an impossible
    acceleration since the triple before. If that triple is too old to be used, a new span begins instead."""
    spans: list[list[tuple[float, float, float]]] = []
    for one in said:
        passed = one[0] - spans[-1][-1][0] if spans else np.inf
        # A change is checked as if it took at least 0.1 s, so that rounding is not mistaken for an acceleration.
        is_near = bool(spans) and abs(one[1] - spans[-1][-1][1]) <= config.most_acceleration * max(passed, 0.1)
        if passed <= 0 or (passed <= config.oldest_ms * 1e-3 and not is_near):
            continue
        if not is_near:
            spans.append([])
        spans[-1].append(one)
    return spans
