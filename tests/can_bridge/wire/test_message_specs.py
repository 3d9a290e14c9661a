"""The numbers in code against the DBC, as cantools reads it."""

import pytest

from can_bridge.wire import message_specs as specs
from can_bridge.wire.messages import BUS_OFF_LIMIT, COUNT_LIMIT, SENSORS, Mode, Reason
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


def test_every_message_is_specified_once():
    assert {message.name for message in DBC.messages} == {spec.name for spec in specs.SPECS}
    assert len({spec.frame_id for spec in specs.SPECS}) == len({spec.data_id for spec in specs.SPECS}) == 12


def test_resolutions_and_limits_are_the_dbcs():
    pressure, jet, status = (DBC.get_message_by_name(name) for name in ("Pressure", "JetCommand", "EcuStatus"))
    for i in range(SENSORS):
        assert pressure.get_signal_by_name(f"Pressure{i}").scale == specs.PRESSURE_RESOLUTION_PA
        assert pressure.get_signal_by_name(f"Pressure{i}").unit == "Pa"
    assert f"Pressure{SENSORS}" not in pressure.signal_tree
    age = pressure.get_signal_by_name("Age")
    assert (round(age.scale * 1e6), age.unit) == (specs.AGE_RESOLUTION_NS, "ms")
    speed = DBC.get_message_by_name("VehicleSpeed")
    for name, scale, unknown in (
        ("Speed", specs.SPEED_RESOLUTION_M_PER_S, specs.SPEED_UNKNOWN),
        ("AirDensity", specs.DENSITY_RESOLUTION_KG_PER_M3, specs.DENSITY_UNKNOWN),
    ):
        signal = speed.get_signal_by_name(name)
        assert signal.scale == scale
        assert list(signal.choices or ()) == [unknown], name
    flow = jet.get_signal_by_name("Flow")
    assert (flow.scale, flow.unit) == (specs.FLOW_RESOLUTION_M2_PER_S, "m2/s")
    assert flow.maximum == pytest.approx(specs.INT16_MAX * flow.scale)
    for name in ("Overruns", "Missed", "CrcErrors"):
        assert status.get_signal_by_name(name).maximum == COUNT_LIMIT
    assert status.get_signal_by_name("BusOff").maximum == BUS_OFF_LIMIT


def test_value_tables_are_the_dbcs():
    for message, signal, table in [
        ("JetCommand", "Mode", Mode),
        ("EcuStatus", "State", Mode),
        ("EcuStatus", "Reason", Reason),
        ("EcuStatusClassic", "Reason", Reason),
    ]:
        choices = DBC.get_message_by_name(message).get_signal_by_name(signal).choices
        assert choices is not None
        assert {value: str(name) for value, name in choices.items()} == {item.value: item.name for item in table}, (
            message,
            signal,
            table,
        )
