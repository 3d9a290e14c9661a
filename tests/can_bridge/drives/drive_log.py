"""Logs of drives whose content is known, and how a log's series is compared with its drive.

That our codecs are the DBC's, and our protection AUTOSAR's, is tested in `tests/can_bridge/{wire,e2e,secoc}`.
"""

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import can
import numpy as np
import numpy.typing as npt

from can_bridge.bus.conversion import to_message
from can_bridge.drives.log_periods import Scales
from can_bridge.drives.log_to_series import LogSeries, series_of
from can_bridge.e2e.profiles import SenderState, profile_of, protected_frame
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import Freshness, secure
from can_bridge.wire.message_sets import CLASSIC, FD, SECURED, Message
from can_bridge.wire.messages import JetCommand, Mode, Pressure, VehicleSpeed
from contract.config.operating_point import OperatingPoint

Array = npt.NDArray[np.float64]

PERIOD: Final = 0.02
PRESSURE: Final = 375.0
"""rho U_inf^2 / 2 in Pa at 25 m/s and 1.2 kg/m3."""
FLOW: Final = 62.5
"""U_inf W in m2/s at 25 m/s and 2.5 m."""
LATENCY: Final = 0.4
"""The time from pressure to command, as a share of a period."""
SETS: Final = {"fd": FD, "classic": CLASSIC, "secured": SECURED}
STEP: Final = {kind: one.pressure_resolution_pa for kind, one in SETS.items()}
"""Steps of a pressure on the wire, Pa."""
KEY: Final = bytes(range(1, 17))
VALID: Final = (True,) * 4


@dataclass(frozen=True)
class Drive:
    """What happened: Cp (n, 4) and action (n,), on the wire's steps."""

    kind: str
    Cp: Array
    action: Array


def drive(kind: str, rows: int, seed: int) -> Drive:
    """Smooth pressures and actions, rounded to what the wire can carry; the jets begin shut."""
    phases, t = np.random.default_rng(seed).uniform(0, 6, 4), np.arange(rows)
    raw = np.round((-60.0 + 40.0 * np.sin(t[:, None] / 4.0 + phases)) / STEP[kind])
    action = np.round(4.0 / 2e-4 * np.sin(t / 5.0)) * 2e-4 / FLOW
    return Drive(kind, raw * STEP[kind] / PRESSURE, action)


def pressure(
    one: Drive, k: int, time_s: float, *, valid: Sequence[bool] = VALID, age_ms: float = 0.0, counter: int | None = None
) -> can.Message:
    values = Pressure(tuple(one.Cp[k] * PRESSURE), tuple(valid), True, round(age_ms * 1e6))
    return framed(SETS[one.kind].pressure, values, k if counter is None else counter, time_s)


def command(
    one: Drive, k: int, time_s: float, *, echo: int | None = None, action: float | None = None, **changes: Any
) -> can.Message:
    """The JetCommand that answers row k, or with other values."""
    message, flow = SETS[one.kind].command, (one.action[k] if action is None else action) * FLOW
    echoed = (k if echo is None else echo) % profile_of(SETS[one.kind].pressure.spec).counter_period
    return framed(message, JetCommand(flow, Mode.CONTROL, True, echoed)._replace(**changes), k + 7, time_s)


def speed(kind: str, k: int, time_s: float, value: float | None, density: float | None = None) -> can.Message:
    """The VehicleSpeed of period k, in m/s, and the density of the air in kg/m3."""
    return framed(SETS[kind].speed, VehicleSpeed(value, 0, density), k, time_s)


def framed(message: Message[Any], values: Any, counter: int, time_s: float) -> can.Message:
    spec = message.spec
    state = SenderState(counter=counter % profile_of(spec).counter_period)
    frame = protected_frame(state, message.emit(values), spec=spec, now_ns=0)
    if spec.is_secured:
        frame = secure(frame, spec, Key(KEY), Freshness(count=counter))
    return at(to_message(frame), time_s)


def log_of(
    one: Drive, start_s: float = 1000.0, period_s: float = PERIOD, rows: Iterable[int] | None = None
) -> list[can.Message]:
    """Every frame of a drive in which nothing went wrong, or those of some rows."""
    return [
        make(one, k, start_s + (k + late) * period_s)
        for k in (range(len(one.action)) if rows is None else rows)
        for make, late in ((pressure, 0.0), (command, LATENCY))
    ]


SCALES = Scales(period=0.2, point=OperatingPoint(), action_limit=0.075)
EXACT = 1e-12
"""Two ways to multiply the same steps of the wire."""
KINDS = ("fd", "classic", "secured")


def read(messages: list[can.Message], scales: Scales = SCALES, **options: Any) -> LogSeries:
    return series_of(Path("drive.blf"), messages, scales, **{"fill": 2, "split": False, **options})


def in_time(messages: list[can.Message]) -> list[can.Message]:
    return sorted(messages, key=lambda message: message.timestamp)


def close(found: Array | float, wanted: Array | float) -> None:
    np.testing.assert_allclose(found, wanted, rtol=0, atol=EXACT)


def same(series: LogSeries, one: Drive, first: int = 0) -> None:
    (piece,) = series.pieces
    close(piece.Cp, one.Cp[first : first + len(piece)])
    close(piece.action, one.action[first : first + len(piece)])


def at(message: can.Message, time_s: float) -> can.Message:
    changed = copy.copy(message)
    changed.timestamp = time_s
    return changed


def noise(message: can.Message, generator: np.random.Generator) -> can.Message:
    changed = at(message, message.timestamp)
    changed.data = bytearray(generator.bytes(int(generator.integers(0, 65))))
    return changed
