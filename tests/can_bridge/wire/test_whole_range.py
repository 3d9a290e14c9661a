"""Every value of every signal, one signal at a time, in all sets, both ways against cantools."""

from typing import Any

import pytest

from can_bridge.wire.message_sets import SETS
from can_bridge.wire.messages import Mode, Reason
from tests.can_bridge.wire.described import DBC

BEHIND = ("E2E_CRC", "E2E_Counter", "Freshness", "MAC")
"""Not the codec's: filled in by the protection around it."""
WIDE = 10
"""Bits up to which every value is tried; of a wider signal every 61st, the powers of two and their neighbours."""
SCALED = ("Pressure0", "Flow", "Age", "Speed", "AirDensity")
"""Signals whose values are rounded: every value of each."""
TABLES = {"Mode": len(Mode), "State": len(Mode), "Reason": len(Reason)}


def raw_values(signal):
    if signal.name in TABLES:
        return range(TABLES[signal.name])
    low, high = (-(1 << signal.length - 1), 1 << signal.length - 1) if signal.is_signed else (0, 1 << signal.length)
    if signal.length <= WIDE or signal.name in SCALED:
        return range(low, high)
    near = (value + step for value in (1 << bit for bit in range(signal.length + 1)) for step in (-1, 0, 1))
    some = range(low, high, 61) if signal.length <= 16 else ()
    return sorted({0, *some, *(value for value in near if low <= value < high)})


@pytest.mark.slow  # 65,536 encodings by cantools for each of the scaled signals
def test_every_value_means_the_same_to_cantools():
    messages: list[Any] = [one for used in SETS for one in (used.pressure, used.speed, used.command, used.status)]
    # Two sets have the same codec.
    for message in {one.parse: one for one in messages}.values():
        described = DBC.get_message_by_name(message.spec.name)
        for signal in (one for one in described.signals if one.name not in BEHIND):
            # A counter that is not flagged as valid is not sent again.
            fixed = {"PressureCounterValid": 1} if signal.name == "PressureCounter" else {}
            rest = dict.fromkeys((item.name for item in described.signals), 0) | fixed
            for raw in raw_values(signal):
                case = (message.spec.name, signal.name, raw)
                data = described.encode({**rest, signal.name: raw}, scaling=False, strict=False)
                value = message.parse(data[: message.spec.protected])
                assert value is not None, case
                assert message.emit(value) == data[: message.spec.protected], case
