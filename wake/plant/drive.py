"""The free stream as a function of time: gusts, and the speed of a vehicle from a shipped profile or a user's file.

The unit of speed is U, the speed of the operating point. A gust is a head wind that varies in time and is uniform far
from the body. It is computed as a change of the body's speed through the air (`wake.solver.navier_stokes`). Forces and
pressures are made dimensionless with U at every speed.
"""

import csv
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, inf, isfinite, pi, sin
from pathlib import Path
from typing import Final

from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.errors import ConfigError

Wind = Callable[[float], float]
"""A function of the time in t_c that returns by how much the wind exceeds U_inf, in units of U_inf."""


@dataclass(frozen=True, kw_only=True)
class Gust:
    """A wind that oscillates sinusoidally about U_inf. The amplitude is in U_inf; the period and the start are in t_c.
    `cycles` is infinite, or a whole number, so that the gust ends at U_inf."""

    amplitude: float
    period: float
    start: float = 0.0
    cycles: float = inf

    def __call__(self, t: float) -> float:
        """Return by how much the wind exceeds U_inf at time t; see `Wind`."""
        phase = (t - self.start) / self.period
        return self.amplitude * sin(2.0 * pi * phase) if 0.0 <= phase <= self.cycles else 0.0


_HEADER: Final = ("t_s", "speed_m_per_s")
MOST_RATIO: Final = 2.0
"""Largest ratio of a vehicle speed to U. At this ratio Re is 1000; at larger Re the mesh does not resolve the wake."""
_MOST_ROWS: Final = 100_000
DESIGN_KM_PER_H: Final = 90.0
"""The speed in the WLTC that is scaled to U. If U is 25 m/s (90 km/h), the speeds of the WLTC do not change."""
_WLTC: Final = """
60.2 62.3 64.7 67.1 69.2 70.7 71.9 72.7 73.4 73.8 74.1 74.0 73.6 72.5 70.8 68.6 66.2 64.0 62.2 60.9 60.2 60.0 60.4 61.4
63.2 65.6 68.4 71.6 74.9 78.4 81.8 84.9 87.4 89.0 90.0 90.6 91.0 91.5 92.0 92.7 93.4 94.2 94.9 95.7 96.6 97.7 98.9 100.4
102.0 103.6 105.2 106.8 108.5 110.2 111.9 113.7 115.3 116.8 118.2 119.5 120.7 121.8 122.6 123.2 123.6 123.7 123.6 123.3
123.0 122.5 122.1 121.5 120.8 120.0 119.1 118.1 117.1 116.2 115.5 114.9 114.5
"""
"""Speeds in km/h at 1 Hz: seconds 1512 to 1592 of the WLTC, class 3b, extra-high part (UN GTR No. 15, annex 1)."""


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A vehicle speed in m/s (`speeds`) that changes linearly between increasing instants in s (`times`), and is
    constant before and after them. `name` is the name of the profile or of the user's file. `gust` is a wind that is
    added to the speed; its times are in t_c = W / U, counted from the first instant."""

    name: str
    times: tuple[float, ...]
    speeds: tuple[float, ...]
    gust: Gust | None = None

    @property
    def duration_s(self) -> float:
        """Time in s from the first instant to the last."""
        return self.times[-1] - self.times[0]

    def speed(self, t_s: float) -> float:
        """Return the speed in m/s at a time in s."""
        after = bisect_right(self.times, t_s)
        if after in (0, len(self.times)):
            return self.speeds[after and -1]
        t0, t1, v0, v1 = *self.times[after - 1 : after + 1], *self.speeds[after - 1 : after + 1]
        return v0 + (v1 - v0) * (t_s - t0) / (t1 - t0)

    def after(self, seconds: float) -> "Drive":
        """Return this drive, delayed by `seconds`."""
        return replace(self, times=tuple(t + seconds for t in self.times))

    def wind(self, point: OperatingPoint, begin: float = 0.0) -> Wind:
        """Return the stream's excess over U as a function of the plant's time. The drive starts at `begin`, in t_c."""
        return partial(self._exceeds, point, begin)  # unlike a closure, a partial can be pickled

    def _exceeds(self, point: OperatingPoint, begin: float, t: float) -> float:
        t_c, gust = point.convective_time, self.gust
        ahead = self.speed((t - begin) * t_c) / point.speed - 1.0
        return ahead if gust is None else ahead + gust(t - begin - self.times[0] / t_c)

    def substeps(self, flow: FlowConfig, point: OperatingPoint) -> FlowConfig:
        """Return the flow's settings with enough time steps per control period for the drive's fastest stream."""
        fastest = max(self.speeds) / point.speed + (0.0 if self.gust is None else self.gust.amplitude)
        return at_speed(flow, fastest)


def at_speed(flow: FlowConfig, fastest: float) -> FlowConfig:
    """Return the flow's settings with enough time steps per control period for a stream of `fastest` times U."""
    # Without the subtraction, rounding would give 43 time steps for 30 * 1.4, although 42 are enough.
    return replace(flow, substeps=ceil(flow.substeps * max(1.0, fastest) - 1e-9))


_PROFILES: Final[Mapping[str, Sequence[tuple[float, float]]]] = {
    **{f"steady-{percent}": ((0.0, percent / 100), (20.0, percent / 100)) for percent in range(60, 150, 10)},
    # Each speed is constant for 8 s; the change to the next speed takes 2 s.
    "steps": [(10.0 * k + t, 0.6 + 0.2 * k) for k in range(5) for t in (0.0, 8.0)],
    "ramps": ((0.0, 0.6), (15.0, 1.4), (20.0, 1.4), (35.0, 0.6), (40.0, 0.6)),
    "wltc-high": [(float(t), float(v) / DESIGN_KM_PER_H) for t, v in enumerate(_WLTC.split())],
    "gusty-ramp": ((0.0, 0.8), (30.0, 1.2)),
}
"""The shipped profiles by name. A profile is a list of pairs (time in s, speed in U)."""
PROFILES: Final = tuple(_PROFILES)
_GUSTS: Final = {"gusty-ramp": Gust(amplitude=0.1, period=20.0)}


def find_drive(text: str, point: OperatingPoint) -> Drive:
    """Return the shipped profile that is called `text`, or read the file with this path. Raises ConfigError if there is
    no such profile or file, or if the file does not contain a drive; the message states the wrong line and value."""
    if text in _PROFILES:
        times, ratios = zip(*_PROFILES[text], strict=True)
        return Drive(name=text, times=times, speeds=tuple(r * point.speed for r in ratios), gust=_GUSTS.get(text))
    if not text.lower().endswith(".csv"):
        raise ConfigError(f"drive {text!r}: must be a file ending in .csv, or one of {', '.join(PROFILES)}")
    return read_drive(Path(text), point)


def read_drive(path: Path, point: OperatingPoint) -> Drive:
    """Read a drive from a CSV file with the columns of `_HEADER`. Raises the errors of `find_drive`."""
    rows = list[tuple[float, float]]()
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            table = csv.DictReader(file, skipinitialspace=True)
            if missing := [name for name in _HEADER if name not in (table.fieldnames or ())]:
                raise ConfigError(f"drive {path}: no column {missing[0]}; the header must be {','.join(_HEADER)}")
            for row in table:
                rows.append(_row(row, f"drive {path}, line {table.line_num}", MOST_RATIO * point.speed))
                if len(rows) > _MOST_ROWS:
                    raise ConfigError(f"drive {path}: has more than {_MOST_ROWS} rows")
                if len(rows) > 1 and not rows[-1][0] > rows[-2][0]:
                    raise ConfigError(
                        f"drive {path}, line {table.line_num}: t_s = {rows[-1][0]:g} comes after {rows[-2][0]:g}; "
                        "times must rise"
                    )
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"drive {path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    if not rows:
        raise ConfigError(f"drive {path}: has no row; must have at least one time and speed")
    times, speeds = zip(*rows, strict=True)
    return Drive(name=path.name, times=times, speeds=speeds).after(-times[0])


def _row(row: Mapping[str, str | None], where: str, fastest: float) -> tuple[float, float]:
    values = []
    for name in _HEADER:
        text = row[name]
        try:
            value = float(text or "")
        except ValueError:
            value = float("nan")
        if not isfinite(value):
            raise ConfigError(f"{where}: {name} = {text!r} must be a number")
        values.append(value)
    t, speed = values
    if not 0.0 <= speed <= fastest:
        raise ConfigError(
            f"{where}: speed_m_per_s = {speed:g} must be in 0..{fastest:g} ({MOST_RATIO:g} times operating_point.speed)"
        )
    return t, speed
