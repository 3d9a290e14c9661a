"""What frames hold, read by cantools and autosar-e2e from the DBC: nothing of the ECU's own code has a part in it."""

from functools import cache
from typing import Any, Final

from e2e.p05 import e2e_p05_check

from can_bridge.wire.frame import Frame
from tests.can_bridge.wire.described import DBC

PRESSURE, COMMAND, STATUS = "Pressure", "JetCommand", "EcuStatus"


@cache
def message(name: str) -> Any:
    return DBC.get_message_by_name(name)


def is_sound(data: bytes, name: str) -> bool:
    if len(data) != message(name).length:
        return False
    # autosar-e2e takes a mutable buffer only.
    return bool(e2e_p05_check(bytearray(data), int(message(name).dbc.attributes["E2EDataID"].value)))


def read(frame: Frame, name: str) -> dict[str, Any] | None:
    """The signals of a sound frame of this message, in the DBC's units; None if it is none."""
    if frame.frame_id != message(name).frame_id or not is_sound(frame.data, name):
        return None
    signals: dict[str, Any] = message(name).decode_simple(frame.data, decode_choices=False)
    return signals


MODES: Final = ("OFF", "WARMUP", "CONTROL", "HOLD", "DECAY", "FAULT")
DRIVING: Final = (2, 3, 4)
OFF, WARMUP, CONTROL, HOLD, DECAY, FAULT = range(6)
"""As in the DBC's table of modes."""
