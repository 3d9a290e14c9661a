"""A virtual bus in this process, and a log of stillwake's own messages with what else a bus carries."""

from pathlib import Path

import can

from can_bridge.bus.conversion import to_message
from can_bridge.e2e.profiles import E2eSender
from can_bridge.tools.signals import encode
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND, PRESSURE
from tests.can_bridge.logs import log_texts

VIRTUAL = ("--set", "bus.interface=virtual", "--set", "bus.channel=test-can")


def write(path: Path, periods: int) -> list[can.Message]:
    """Write a log and return what it holds: each 20 ms three frames of ours and one with an extended identifier."""
    senders = {spec.name: E2eSender(spec) for spec in (PRESSURE, JET_COMMAND, ECU_STATUS)}
    made = []
    for i in range(periods):
        t = 1_700_000_000.0 + i * 0.02
        for name, at, values in (
            ("Pressure", 0.0, [f"Pressure0={-100 + i % 50}", "Valid0=1", "EnableRequest=1"]),
            ("JetCommand", 0.008, ["Mode=CONTROL", "Enable=1", f"Flow={(i % 20) / 10}"]),
            ("EcuStatus", 0.0085, ["State=CONTROL", f"Missed={i}"]),
        ):
            frame = senders[name].frame(encode(name, values)[1], now_ns=round((t + at) * 1e9))
            made.append(to_message(frame))
        made.append(can.Message(timestamp=t + 0.012, arbitration_id=0x18FEF100, data=bytes([i % 256] * 8)))
    log_texts.write(path, made)
    return made


def taken(peer: can.BusABC) -> list[can.Message]:
    messages = []
    while (message := peer.recv(timeout=0.0)) is not None:
        messages.append(message)
    return messages


def flat(text: str) -> str:
    return " ".join(text.split())
