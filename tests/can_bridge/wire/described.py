"""The DBC as cantools reads it, strictly and without a warning, and messages that differ from a usual one in fields."""

import warnings
from importlib.resources import files
from typing import Any

from cantools.database import Database

from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason, VehicleSpeed

DBC = Database(strict=True)
with warnings.catch_warnings():
    warnings.simplefilter("error")
    DBC.add_dbc_string(files("contract").joinpath("stillwake.dbc").read_text())


def decoded(name: str, data: bytes) -> dict[str, Any]:
    signals = DBC.decode_message(name, data, decode_choices=False)
    assert isinstance(signals, dict)
    return signals


def pressure(**changes: Any) -> Pressure:
    fields: dict[str, Any] = {"pressure_pa": (0.0,) * 4, "valid": (True,) * 4, "enable_request": False, "age_ns": 0}
    return Pressure(**{**fields, **changes})


def speed(**changes: Any) -> VehicleSpeed:
    return VehicleSpeed(**{"speed_m_per_s": 0.0, "age_ns": 0, **changes})


def jet(**changes: Any) -> JetCommand:
    fields: dict[str, Any] = {"flow_m2_per_s": 0.0, "mode": Mode.OFF, "enable": False, "pressure_counter": None}
    return JetCommand(**{**fields, **changes})


def status(**changes: Any) -> EcuStatus:
    fields: dict[str, Any] = {"state": Mode.OFF, "reason": Reason.NONE}
    counts = dict.fromkeys(("overruns", "missed", "crc_errors", "bus_off", "bundle_hash"), 0)
    return EcuStatus(**{**fields, **counts, **changes})
