"""Every value of every signal, one signal at a time, in all sets, both ways against cantools."""

from importlib.resources import files

import pytest
from cantools.database import Database

from can_bridge.wire.message_sets import SETS
from can_bridge.wire.messages import Mode, Reason

DBC = Database()
DBC.add_dbc_string(files("contract").joinpath("stillwake.dbc").read_text())
BEHIND = ("E2E_CRC", "E2E_Counter", "Freshness", "MAC")
"""Not the codec's: filled in by the protection around it."""
WIDE = 16
"""Bits up to which every value is tried; of a wider signal the powers of two and their neighbours."""
TABLES = {"Mode": len(Mode), "State": len(Mode), "Reason": len(Reason)}


def cases():
    for messages in SETS:
        for message in (messages.pressure, messages.command, messages.status):
            for signal in DBC.get_message_by_name(message.spec.name).signals:
                if signal.name not in BEHIND:
                    yield pytest.param(message, signal, id=f"{message.spec.name}.{signal.name}")


def raw_values(signal):
    if signal.name in TABLES:
        return range(TABLES[signal.name])
    low, high = (-(1 << signal.length - 1), 1 << signal.length - 1) if signal.is_signed else (0, 1 << signal.length)
    if signal.length <= WIDE:
        return range(low, high)
    near = (value + step for value in (1 << bit for bit in range(signal.length + 1)) for step in (-1, 0, 1))
    return sorted({0, *(value for value in near if low <= value < high)})


@pytest.mark.slow  # 65,536 encodings by cantools for each of the wide signals
@pytest.mark.parametrize(("message", "signal"), list(cases()))
def test_every_value_means_the_same_to_cantools(message, signal):
    described = DBC.get_message_by_name(message.spec.name)
    # A counter that is not flagged as valid is not sent again.
    fixed = {"PressureCounterValid": 1} if signal.name == "PressureCounter" else {}
    rest = dict.fromkeys((item.name for item in described.signals), 0) | fixed
    for raw in raw_values(signal):
        data = described.encode({**rest, signal.name: raw}, scaling=False, strict=False)[: message.spec.protected]
        value = message.parse(data)
        assert value is not None, raw
        assert message.emit(value) == data, raw
