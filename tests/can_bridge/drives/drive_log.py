"""Logs of drives whose content is known: encoded by cantools, protected by autosar-e2e, nothing of it by ourselves; and
how a log's series is compared with its drive."""

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import can
import numpy as np
import numpy.typing as npt
from e2e.p02 import e2e_p02_protect
from e2e.p05 import e2e_p05_protect

from can_bridge.drives.log_periods import Scales
from can_bridge.drives.log_to_series import LogSeries, series_of
from contract.config.operating_point import OperatingPoint
from tests.can_bridge.uds.test_security import cmac
from tests.can_bridge.wire import described

Array = npt.NDArray[np.float64]

PERIOD: Final = 0.02
PRESSURE: Final = 375.0
"""rho U_inf^2 / 2 in Pa at 25 m/s and 1.2 kg/m3."""
FLOW: Final = 62.5
"""U_inf W in m2/s at 25 m/s and 2.5 m."""
LATENCY: Final = 0.4
"""The time from pressure to command, as a share of a period."""
STEP: Final = {"fd": 0.1, "classic": 1.0, "secured": 0.1}
"""Steps of a pressure on the wire, Pa."""
SUFFIX: Final = {"fd": "", "classic": "Classic", "secured": "Secured"}
DATA_IDS: Final = {
    **{"Pressure": 0x5701, "JetCommand": 0x5702, "PressureClassic": 0x71, "JetCommandClassic": 0x72},
    **{"PressureSecured": 0x5704, "JetCommandSecured": 0x5705},
    **{"VehicleSpeed": 0x5707, "VehicleSpeedClassic": 0x74, "VehicleSpeedSecured": 0x5708},
}
MODULUS: Final = {"fd": 256, "classic": 16, "secured": 256}
KEY: Final = bytes(range(1, 17))

DBC: Final[Any] = described.DBC


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
    one: Drive,
    k: int,
    time_s: float,
    *,
    valid: Sequence[bool] = (True,) * 4,
    age_ms: float = 0.0,
    counter: int | None = None,
) -> can.Message:
    """The Pressure frame of row k."""
    values: dict[str, float] = {f"Pressure{i}": one.Cp[k, i] * PRESSURE for i in range(4)}
    if one.kind == "classic":
        values |= {f"Pressure{i}": -2048 for i in range(4) if not valid[i]}
    else:
        values |= {f"Valid{i}": int(valid[i]) for i in range(4)}
    values |= {"EnableRequest": 1, "Age": age_ms}
    return framed(f"Pressure{SUFFIX[one.kind]}", values, k if counter is None else counter, one.kind, time_s)


def command(
    one: Drive, k: int, time_s: float, *, echo: int | None = None, action: float | None = None, **values: Any
) -> can.Message:
    """The JetCommand that answers row k, with other values of signals."""
    usual = {
        "Flow": (one.action[k] if action is None else action) * FLOW,
        "PressureCounter": (k if echo is None else echo) % MODULUS[one.kind],
        **{"Mode": "CONTROL", "Enable": 1, "PressureCounterValid": 1, "NextPeriod": 0},
    }
    return framed(f"JetCommand{SUFFIX[one.kind]}", usual | values, k + 7, one.kind, time_s)


def speed(kind: str, k: int, time_s: float, value: float | None, density: float = 0.0) -> can.Message:
    """The VehicleSpeed of period k, in m/s, and the density of the air in kg/m3; 0 where it is not known."""
    values = {"Speed": 0xFFFF * 0.005 if value is None else value, "AirDensity": density, "Age": 0.0}
    return framed(f"VehicleSpeed{SUFFIX[kind]}", values, k, kind, time_s)


def framed(name: str, values: dict[str, Any], counter: int, kind: str, time_s: float) -> can.Message:
    """Encoded and protected."""
    message = DBC.get_message_by_name(name)
    values = {"E2E_CRC": 0, "E2E_Counter": counter % MODULUS[kind], **values}
    if kind == "secured":
        values |= {"Freshness": (1 << 32) + counter, "MAC": 0}
    data = bytearray(message.encode(values))
    if kind == "classic":
        e2e_p02_protect(data, bytes([DATA_IDS[name]] * 16), increment_counter=False)
    elif kind == "fd":
        e2e_p05_protect(data, DATA_IDS[name], increment_counter=False)
    else:
        covered = data[: 16 if name.startswith("Pressure") else 8]
        e2e_p05_protect(covered, DATA_IDS[name], increment_counter=False)
        covered += data[len(covered) : -8]
        data = covered + cmac(KEY, DATA_IDS[name].to_bytes(2, "big") + bytes(covered))[:8]
    return can.Message(
        timestamp=time_s,
        arbitration_id=message.frame_id,
        is_extended_id=False,
        is_fd=kind != "classic",
        bitrate_switch=kind != "classic",
        data=data,
    )


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
LOG = Path("drive.blf")
EXACT = 1e-12
"""Two ways to multiply the same steps of the wire."""
KINDS = ("fd", "classic", "secured")


def read(messages: list[can.Message], **options: Any) -> LogSeries:
    return series_of(LOG, messages, SCALES, **{"fill": 2, "split": False, **options})


def in_time(messages: list[can.Message]) -> list[can.Message]:
    return sorted(messages, key=lambda message: message.timestamp)


def same(series: LogSeries, one: Drive, first: int = 0) -> None:
    (piece,) = series.pieces
    np.testing.assert_allclose(piece.Cp, one.Cp[first : first + len(piece)], atol=EXACT)
    np.testing.assert_allclose(piece.action, one.action[first : first + len(piece)], atol=EXACT)


def at(message: can.Message, time_s: float) -> can.Message:
    changed = copy.copy(message)
    changed.timestamp = time_s
    return changed


def noise(message: can.Message, generator: np.random.Generator) -> can.Message:
    changed = at(message, message.timestamp)
    changed.data = bytearray(generator.bytes(int(generator.integers(0, 65))))
    return changed
