"""The DBC as cantools reads it, strictly and without a warning, and messages that differ from a usual one in fields."""

import warnings
from collections.abc import Callable
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


pressure: Callable[..., Pressure] = Pressure((0.0,) * 4, (True,) * 4, enable_request=False, age_ns=0)._replace
speed: Callable[..., VehicleSpeed] = VehicleSpeed(0.0, 0)._replace
jet: Callable[..., JetCommand] = JetCommand(0.0, Mode.OFF, enable=False, pressure_counter=None)._replace
status: Callable[..., EcuStatus] = EcuStatus(Mode.OFF, Reason.NONE, *(0,) * 5)._replace
