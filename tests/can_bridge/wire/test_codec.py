"""The codecs and the numbers in code against the DBC, as cantools reads it; rounding, limits, what eight bytes leave
out, and what is refused. `tools/test_signals` decodes any message with cantools."""

import math
from itertools import product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire import classic_codec, codec
from can_bridge.wire import message_specs as specs
from can_bridge.wire.classic_codec import STALE_NS
from can_bridge.wire.message_sets import CLASSIC, FD
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason, VehicleSpeed
from contract.config.tree import Config
from tests.can_bridge.wire.described import DBC, jet, pressure, speed, status
from tests.refused import refused

MESSAGES: list[Any] = [one for used in (FD, CLASSIC) for one in (used.pressure, used.speed, used.command, used.status)]
"""One for each codec; the authenticated set has the codec of CAN FD."""


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
SCALED = ("Pressure0", "Flow", "Age", "Speed", "AirDensity")
"""Signals whose values are rounded: every value of each."""
TABLES = {"Mode": len(Mode), "State": len(Mode), "Reason": len(Reason)}


def raw_values(signal):
    """All of a signal up to 10 bits; of a wider one every 61st, the powers of two and their neighbours."""
    if signal.name in TABLES:
        return range(TABLES[signal.name])
    low, high = (-(1 << signal.length - 1), 1 << signal.length - 1) if signal.is_signed else (0, 1 << signal.length)
    if signal.length <= 10 or signal.name in SCALED:
        return range(low, high)
    near = (value + step for value in (1 << bit for bit in range(signal.length + 1)) for step in (-1, 0, 1))
    some = range(low, high, 61) if signal.length <= 16 else ()
    return sorted({0, *some, *(value for value in near if low <= value < high)})


@pytest.mark.slow  # 65,536 values of each of the scaled signals
def test_every_value_means_the_same_to_cantools():
    for message in MESSAGES:
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


def received(module: Any, name: str, message: Any) -> Any:
    found = getattr(module, f"parse_{name}")(getattr(module, f"emit_{name}")(message))
    assert found is not None
    return found


def test_values_are_rounded_to_the_nearest_step():
    """The command gate works in steps of the flow and need not know the set; so both sets have the same."""
    message: Any
    for module, resolution, most in ((codec, 0.1, 32767), (classic_codec, 1.0, 2047)):
        for steps, part in product((-most, -1, 0, 1, 1234, most), (-0.49, 0.0, 0.49)):
            close = pytest.approx(steps * resolution)
            message = pressure(pressure_pa=((steps + part) * resolution, 0.0, 0.0, 0.0), enable_request=True)
            assert received(module, "pressure", message) == message._replace(pressure_pa=(close, 0.0, 0.0, 0.0))
        for steps, part in product((-32768, -1, 0, 1, 32767), (-0.49, 0.0, 0.49)):
            message = jet(flow_m2_per_s=(steps + part) * 0.0002, mode=Mode.HOLD, pressure_counter=15, next_period=True)
            found = received(module, "jet_command", message)
            assert found == message._replace(flow_m2_per_s=pytest.approx(steps * 0.0002)), steps
        for steps, part in product((0, 1, 65534), (-0.49, 0.0, 0.49)):
            message = speed(speed_m_per_s=max(0.0, (steps + part) * 0.005), density_kg_per_m3=(123 + part) * 0.01)
            found = received(module, "vehicle_speed", message)
            assert found == (pytest.approx(steps * 0.005), 0, pytest.approx(1.23)), steps
        assert received(module, "vehicle_speed", speed(speed_m_per_s=None)) == (None, 0, None)


def test_an_age_is_rounded_and_in_the_classic_set_looks_no_fresher_than_it_is():
    for name, message in (("pressure", pressure()), ("vehicle_speed", speed())):
        for age, wanted in ((4_999, 0), (5_000, 10_000), (655_354_999, 655_350_000)):
            assert received(codec, name, message._replace(age_ns=age)).age_ns == wanted, age
        most = 60_000_000 if name == "pressure" else 2_550_000_000
        beyond = STALE_NS if name == "pressure" else most
        for age, wanted in ((0, 0), (1, 10_000_000), (most, most), (most + 1, beyond), (10**12, beyond)):
            assert received(classic_codec, name, message._replace(age_ns=age)).age_ns == wanted, age


@given(data=st.binary(max_size=70) | st.sampled_from([8, 16, 24]).flatmap(lambda n: st.binary(min_size=n, max_size=n)))
def test_any_bytes_parse_to_none_or_to_a_message_that_survives(data):
    """Never raises on wire data, and what it returns can be sent again and means the same."""
    for one in MESSAGES:
        message = one.parse(data)
        assert message is None or one.parse(one.emit(message)) == message, one
        assert message is None or len(data) == one.spec.length, one


def test_only_the_messages_own_length_parses_and_zeros_stay_zeros():
    for one in MESSAGES:
        own = one.spec.length
        assert [length for length in range(70) if one.parse(bytes(length)) is not None] == [own], one
        assert one.emit(one.parse(bytes(own))) == bytes(own), one


def test_values_outside_a_table_are_malformed():
    for parse, size, shift, bad in (
        (codec.parse_jet_command, 8, 24, (6, 7)),
        (codec.parse_ecu_status, 24, 24, range(6, 16)),
        (codec.parse_ecu_status, 24, 32, range(18, 256)),
        (classic_codec.parse_jet_command, 8, 12, (6, 7)),
        (classic_codec.parse_ecu_status, 8, 12, (6, 7)),
        (classic_codec.parse_ecu_status, 8, 15, range(18, 32)),
    ):
        assert parse(bytes(size)) is not None, parse
        assert not [value for value in bad if parse((value << shift).to_bytes(size, "little")) is not None], parse


def test_what_eight_bytes_leave_out():
    """A sensor that is not valid loses its value, a count stays at its largest value, the hash loses its lower half."""
    message = pressure(pressure_pa=(-2047.0, 1.0, 2047.0, 5.0), valid=(True, False, True, True), age_ns=10_000_000)
    assert received(classic_codec, "pressure", message) == message._replace(pressure_pa=(-2047.0, 0.0, 2047.0, 5.0))
    full = EcuStatus(
        state=Mode.FAULT, reason=Reason.CLOCK, overruns=65535, missed=64, crc_errors=1000, refused=63, bus_off=255,
        bundle_hash=0xD3061D50, not_authentic=5, tx_errors=255, rx_errors=127, set_aside=0b1010,
    )  # fmt: skip
    assert received(classic_codec, "ecu_status", full) == EcuStatus(
        state=Mode.FAULT, reason=Reason.CLOCK, overruns=63, missed=63, crc_errors=63, refused=63, bus_off=15,
        bundle_hash=0xD3060000,
    )  # fmt: skip


EMITS = {Pressure: "emit_pressure", VehicleSpeed: "emit_vehicle_speed", JetCommand: "emit_jet_command"}


def test_what_the_wire_cannot_carry_is_refused_by_name():
    counts = ("overruns", "missed", "crc_errors", "refused", "not_authentic")
    cases: dict[Any, dict[str, Any]] = {
        codec: {
            "pressure_pa has 3 values": pressure(pressure_pa=(0.0,) * 3),
            "valid has 1 values": pressure(valid=(True,)),
            r"pressure_pa.* = nan: must be finite": pressure(pressure_pa=(0.0, math.nan, 0.0, 0.0)),
            r"3276\.76: must be in -3276\.8\.\.3276\.7": pressure(pressure_pa=(3276.76, 0.0, 0.0, 0.0)),
            r"1e\+300": pressure(pressure_pa=(1e300, 0.0, 0.0, 0.0)),
            "age_ns = -5001": pressure(age_ns=-5_001),
            r"VehicleSpeed\.age_ns = 655355000": speed(age_ns=655_355_000),
            r"speed_m_per_s = -0\.1: must be in 0\.\.327\.67": speed(speed_m_per_s=-0.1),
            r"speed_m_per_s = 327\.673: must": speed(speed_m_per_s=327.673),  # which would be 0xFFFF
            r"density_kg_per_m3 = 0\.0: must be in 0\.01\.\.2\.55": speed(density_kg_per_m3=0.0),
            r"density_kg_per_m3 = 2\.6": speed(density_kg_per_m3=2.6),
            r"flow_m2_per_s = 6\.5536": jet(flow_m2_per_s=6.5536),
            "pressure_counter = 256": jet(pressure_counter=256),
            "6 is not a valid Mode": jet(mode=6),
            **{f"{name} = 65536": status(**{name: 65536}) for name in counts},
            **{f"{name} = 256": status(**{name: 256}) for name in ("bus_off", "tx_errors", "rx_errors")},
            "set_aside = 16: must be in 0..15": status(set_aside=16),
            "bundle_hash": status(bundle_hash=2**32),
            "9 is not a valid Mode": status(state=9),
            "18 is not a valid Reason": status(reason=18),
        },
        classic_codec: {
            "valid has 5 values": pressure(valid=(True,) * 5),
            r"2047\.6: must be in -2047\.\.2047": pressure(pressure_pa=(2047.6, 0.0, 0.0, 0.0)),
            r"-2048\.0: must be in": pressure(pressure_pa=(-2048.0, 0.0, 0.0, 0.0)),
            r"Pressure.*age_ns = -1: must not be negative": pressure(age_ns=-1),
            r"VehicleSpeed.*age_ns = -1: must not be negative": speed(age_ns=-1),
            r"pressure_counter = 16: must be in 0\.\.15": jet(pressure_counter=16),
            **{f"{name} = -1": status(**{name: -1}) for name in ("missed", "bus_off")},
            "bundle_hash": status(bundle_hash=2**32),
        },
    }
    for codec_used, messages in cases.items():
        for culprit, message in messages.items():
            with refused(ValueError, culprit):
                getattr(codec_used, EMITS.get(type(message), "emit_ecu_status"))(message)
