"""The numbers in code against the DBC, as cantools reads it."""

from typing import Any

import pytest

from can_bridge.wire import message_specs as specs
from can_bridge.wire.message_sets import SETS
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from tests.can_bridge.wire.described import DBC


def test_message_is_the_dbcs():
    for spec in specs.SPECS:
        message = DBC.get_message_by_name(spec.name)
        assert message.dbc is not None
        attributes = {name: attribute.value for name, attribute in message.dbc.attributes.items()}
        assert (message.frame_id, message.length) == (spec.frame_id, spec.length), spec
        assert (attributes["E2EProfile"], attributes["E2EDataID"]) == (spec.profile, spec.data_id), spec
        assert message.is_fd == spec.is_fd, spec
        assert attributes["CANFD_BRS"] == int(spec.is_fd), spec
        assert not message.is_extended_frame, spec
        assert message.cycle_time is not None
        assert message.cycle_time * 1_000_000 == Config().period_ns, spec
        crc, counter = message.get_signal_by_name("E2E_CRC"), message.get_signal_by_name("E2E_Counter")
        widths = {2: (8, 4), 5: (16, 8)}[spec.profile]
        assert (crc.start, crc.length, crc.byte_order, crc.is_signed) == (0, widths[0], "little_endian", False), spec
        assert (counter.start, counter.length) == widths, spec
        assert message.comment, spec
    assert {message.name for message in DBC.messages} == {spec.name for spec in specs.SPECS}
    assert len({spec.frame_id for spec in specs.SPECS}) == len({spec.data_id for spec in specs.SPECS}) == 12


def test_value_tables_are_the_dbcs():
    for message, signal, table in (
        *(("JetCommand", "Mode", Mode), ("EcuStatus", "State", Mode)),
        *(("EcuStatus", "Reason", Reason), ("EcuStatusClassic", "Reason", Reason)),
    ):
        choices = DBC.get_message_by_name(message).get_signal_by_name(signal).choices
        assert choices is not None
        assert {value: str(name) for value, name in choices.items()} == {one.value: one.name for one in table}, message


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


@pytest.mark.slow  # 65,536 values of each of the scaled signals
def test_every_value_means_the_same_to_cantools():
    messages: list[Any] = [one for used in SETS for one in (used.pressure, used.speed, used.command, used.status)]
    # Two sets have the same codec.
    for message in {one.parse: one for one in messages}.values():
        described = DBC.get_message_by_name(message.spec.name)
        for signal in (one for one in described.signals if one.name not in BEHIND):
            # A counter that is not flagged as valid is not sent again.
            fixed = {"PressureCounterValid": 1} if signal.name == "PressureCounter" else {}
            rest = dict.fromkeys((item.name for item in described.signals), 0) | fixed
            assert signal.byte_order == "little_endian"
            zeros = int.from_bytes(described.encode(rest, scaling=False, strict=False), "little")
            for raw in raw_values(signal):
                case = (message.spec.name, signal.name, raw)
                data = (zeros | (raw & (1 << signal.length) - 1) << signal.start).to_bytes(described.length, "little")
                value = message.parse(data[: message.spec.protected])
                assert value is not None, case
                assert message.emit(value) == data[: message.spec.protected], case
