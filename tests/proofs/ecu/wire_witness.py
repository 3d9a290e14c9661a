"""What frames say, read by cantools and autosar-e2e from the DBC: nothing of the ECU's own code has a part in it."""

from functools import cache
from typing import Any, Final

from cantools.database import Database
from e2e.p05 import e2e_p05_check

from can_bridge.wire.frame import Frame
from contract.release.bundle import dbc_bytes

PRESSURE, COMMAND, STATUS = "Pressure", "JetCommand", "EcuStatus"


@cache
def _messages() -> dict[int, Any]:
    dbc = Database()
    dbc.add_dbc_string(dbc_bytes().decode())
    return {message.frame_id: message for message in dbc.messages}


@cache
def _data_id(frame_id: int) -> int:
    return int(_messages()[frame_id].dbc.attributes["E2EDataID"].value)


def read(frame: Frame, name: str) -> dict[str, Any] | None:
    """The signals of a sound frame of this message, in the DBC's units; None if it is none."""
    message = _messages().get(frame.frame_id)
    if message is None or message.name != name or len(frame.data) != message.length:
        return None
    # autosar-e2e takes a mutable buffer only.
    if not e2e_p05_check(bytearray(frame.data), _data_id(frame.frame_id)):
        return None
    signals: dict[str, Any] = message.decode_simple(frame.data, decode_choices=False)
    return signals


MODES: Final = ("OFF", "WARMUP", "CONTROL", "HOLD", "DECAY", "FAULT")
DRIVING: Final = (2, 3, 4)
OFF, WARMUP, CONTROL, HOLD, DECAY, FAULT = range(6)
"""As in the DBC's table of modes."""
