"""A log of stillwake's own messages, with what else a bus carries, for the commands to work on."""

from pathlib import Path

import can

from can_bridge.bus.conversion import to_message
from can_bridge.e2e.sender import E2eSender
from can_bridge.logs.frame_log import recording_messages
from can_bridge.tools.encode import encode
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND, PRESSURE

PERIOD_S = 0.02
BEGIN_S = 1_700_000_000.0
PER_PERIOD = 4


def messages(periods: int) -> list[can.Message]:
    """Four frames a period: three of ours, one with an extended identifier; in the order of time."""
    senders = {spec.name: E2eSender(spec) for spec in (PRESSURE, JET_COMMAND, ECU_STATUS)}
    found = []
    for i in range(periods):
        t = BEGIN_S + i * PERIOD_S
        for name, at, values in (
            ("Pressure", 0.0, [f"Pressure0={-100 + i % 50}", "Valid0=1", "EnableRequest=1"]),
            ("JetCommand", 0.008, ["Mode=CONTROL", "Enable=1", f"Flow={(i % 20) / 10}"]),
            ("EcuStatus", 0.0085, ["State=CONTROL", f"Missed={i}"]),
        ):
            frame = senders[name].frame(encode(name, values)[1], now_ns=round((t + at) * 1e9))
            found.append(to_message(frame))
        found.append(can.Message(timestamp=t + 0.012, arbitration_id=0x18FEF100, data=bytes([i % 256] * 8)))
    return found


def write(path: Path, periods: int) -> list[can.Message]:
    """The same as a log; returns what it holds."""
    made = messages(periods)
    with recording_messages(path) as append:
        for message in made:
            append(message)
    return made
