"""Both directions against cantools reading the DBC."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from can_bridge.wire import codec
from can_bridge.wire.message_sets import FD
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason
from tests.can_bridge.wire.described import DBC, decoded, jet, pressure, status
from tests.refused import refused

# Half a step beyond the last step still rounds to it; these stay clear of the ties.
PASCALS = st.floats(-3276.84, 3276.74)
FLOWS = st.floats(-6.55368, 6.55348)
U8, U16, U32 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32))

PRESSURES = st.builds(
    Pressure,
    pressure_pa=st.tuples(*[PASCALS] * 4),
    valid=st.tuples(*[st.booleans()] * 4),
    enable_request=st.booleans(),
    age_ns=st.integers(0, 655_354_999),
)
JET_COMMANDS = st.builds(
    JetCommand,
    flow_m2_per_s=FLOWS,
    mode=st.sampled_from(Mode),
    enable=st.booleans(),
    pressure_counter=st.none() | U8,
    next_period=st.booleans(),
)
STATUSES = st.builds(
    EcuStatus,
    state=st.sampled_from(Mode),
    reason=st.sampled_from(Reason),
    overruns=U16,
    missed=U16,
    crc_errors=U16,
    refused=U16,
    not_authentic=U16,
    bus_off=U8,
    tx_errors=U8,
    rx_errors=U8,
    bundle_hash=U32,
    set_aside=st.integers(0, 15),
)


@given(PRESSURES)
@example(
    Pressure(pressure_pa=(-3276.8, 3276.7, 0.05, -0.0), valid=(True,) * 4, enable_request=True, age_ns=655_350_000)
)
def test_emitted_pressure_means_the_same_to_cantools(message):
    signals = decoded("Pressure", codec.emit_pressure(message))
    for i in range(4):
        assert signals[f"Pressure{i}"] == pytest.approx(message.pressure_pa[i], abs=0.05 + 1e-9)
        assert signals[f"Valid{i}"] == message.valid[i]
    assert signals["EnableRequest"] == message.enable_request
    assert signals["Age"] == pytest.approx(message.age_ns / 1e6, abs=0.005 + 1e-9)
    assert (signals["E2E_CRC"], signals["E2E_Counter"]) == (0, 0)


@given(JET_COMMANDS)
@example(JetCommand(flow_m2_per_s=-6.5536, mode=Mode.FAULT, enable=False, pressure_counter=255))
@example(JetCommand(flow_m2_per_s=6.5534, mode=Mode.OFF, enable=True, pressure_counter=0))
def test_emitted_jet_command_means_the_same_to_cantools(message):
    signals = decoded("JetCommand", codec.emit_jet_command(message))
    assert signals["Flow"] == pytest.approx(message.flow_m2_per_s, abs=0.0001 + 1e-12)
    assert (signals["Mode"], signals["Enable"]) == (message.mode, message.enable)
    assert signals["PressureCounterValid"] == (message.pressure_counter is not None)
    assert signals["PressureCounter"] == (message.pressure_counter or 0)
    assert signals["NextPeriod"] == message.next_period


@given(data=st.data())
def test_pressure_encoded_by_cantools_is_parsed(data):
    raw = data.draw(st.tuples(*[st.integers(-0x8000, 0x7FFF)] * 4))
    valid = data.draw(st.tuples(*[st.booleans()] * 4))
    enable, age = data.draw(st.booleans()), data.draw(U16)
    signals = {f"Pressure{i}": raw[i] * 0.1 for i in range(4)} | {f"Valid{i}": valid[i] for i in range(4)}
    signals |= {"EnableRequest": enable, "Age": age * 0.01, "E2E_CRC": data.draw(U16), "E2E_Counter": data.draw(U8)}
    parsed = codec.parse_pressure(DBC.encode_message("Pressure", signals, strict=False))
    assert parsed is not None
    assert parsed.pressure_pa == pytest.approx([value / 10 for value in raw])
    assert (parsed.valid, parsed.enable_request, parsed.age_ns) == (valid, enable, age * 10_000)


@given(
    flow=st.integers(-0x8000, 0x7FFF),
    mode=st.sampled_from(Mode),
    enable=st.booleans(),
    echo=st.none() | U8,
    crc=U16,
    later=st.booleans(),
)
def test_jet_command_encoded_by_cantools_is_parsed(flow, mode, enable, echo, crc, later):
    signals = {
        "Flow": flow * 0.0002, "Mode": mode.value, "Enable": enable, "PressureCounterValid": echo is not None,
        "PressureCounter": echo or 0, "E2E_CRC": crc, "E2E_Counter": 7, "NextPeriod": later,
    }  # fmt: skip
    parsed = codec.parse_jet_command(DBC.encode_message("JetCommand", signals, strict=False))
    assert parsed is not None
    assert parsed.flow_m2_per_s == pytest.approx(flow / 5000)
    assert parsed[1:] == (mode, enable, echo, later)


@given(STATUSES)
def test_status_encoded_by_cantools_is_parsed(message):
    signals = {
        "E2E_CRC": 0xFFFF, "E2E_Counter": 0xFF, "State": message.state.value, "Reason": message.reason.value,
        "BusOff": message.bus_off, "Overruns": message.overruns, "Missed": message.missed,
        "CrcErrors": message.crc_errors, "BundleHash": message.bundle_hash, "Refused": message.refused,
        "NotAuthentic": message.not_authentic, "TxErrors": message.tx_errors, "RxErrors": message.rx_errors,
        **{f"SetAside{i}": message.set_aside >> i & 1 for i in range(4)},
    }  # fmt: skip
    assert codec.parse_ecu_status(DBC.encode_message("EcuStatus", signals)) == message


ROUND_TRIPS: list[tuple[Callable[[bytes], Any], Callable[[Any], bytes]]] = [
    (codec.parse_pressure, codec.emit_pressure),
    (codec.parse_jet_command, codec.emit_jet_command),
    (codec.parse_ecu_status, codec.emit_ecu_status),
]


@given(data=st.binary(max_size=70) | st.sampled_from([8, 16, 24]).flatmap(lambda n: st.binary(min_size=n, max_size=n)))
def test_any_bytes_parse_to_none_or_to_a_message_that_survives(data):
    """Never raises on wire data, and what it returns can be sent again and means the same."""
    for parse, emit in ROUND_TRIPS:
        message = parse(data)
        assert message is None or parse(emit(message)) == message, parse


def test_only_the_messages_own_length_parses():
    for parse, spec in [(pair[0], spec) for pair, spec in zip(ROUND_TRIPS, FD.specs, strict=True)]:
        assert [length for length in range(70) if parse(bytes(length)) is not None] == [spec.length], (parse, spec)


def test_values_outside_a_table_are_malformed():
    for parse, size, byte, bad in [
        (codec.parse_jet_command, 8, 3, [6, 7]),
        (codec.parse_ecu_status, 24, 3, range(6, 16)),
        (codec.parse_ecu_status, 24, 4, range(15, 256)),
    ]:
        for value in bad:
            data = bytearray(size)
            data[byte] = value
            assert parse(bytes(data)) is None, (parse, size, byte)


def test_bits_without_a_signal_are_ignored():
    pressure, jet, status = bytearray(16), bytearray(8), bytearray(24)
    expected = [parse(bytes(data)) for (parse, _), data in zip(ROUND_TRIPS, (pressure, jet, status), strict=True)]
    pressure[3], pressure[14], pressure[15] = 0b1110_0000, 0xFF, 0xFF
    jet[3], jet[6], jet[7] = 0b1100_0000, 0xFF, 0xFF  # byte 6 echoes a counter that is flagged as not valid
    status[3], status[22], status[23] = 0b1111_0000, 0xF0, 0xFF
    got = [parse(bytes(data)) for (parse, _), data in zip(ROUND_TRIPS, (pressure, jet, status), strict=True)]
    assert got == expected


def test_what_the_wire_cannot_carry_is_refused_by_name():
    cases: list[tuple[Callable[[Any], bytes], dict[str, Any]]] = [
        (
            codec.emit_pressure,
            {
                "pressure_pa has 3 values": pressure(pressure_pa=(0.0,) * 3),
                "valid has 1 values": pressure(valid=(True,)),
                "nan: must be finite": pressure(pressure_pa=(0.0, math.nan, 0.0, 0.0)),
                r"3276\.76: must be in -3276\.8\.\.3276\.7": pressure(pressure_pa=(3276.76, 0.0, 0.0, 0.0)),
                r"1e\+300": pressure(pressure_pa=(1e300, 0.0, 0.0, 0.0)),
                "age_ns = -5001": pressure(age_ns=-5_001),
                "age_ns = 655355000": pressure(age_ns=655_355_000),
            },
        ),
        (
            codec.emit_jet_command,
            {
                "flow_m2_per_s = -inf": jet(flow_m2_per_s=-math.inf),
                r"flow_m2_per_s = 6\.5536": jet(flow_m2_per_s=6.5536),
                "pressure_counter = 256": jet(pressure_counter=256),
                "pressure_counter = -1": jet(pressure_counter=-1),
                "6 is not a valid Mode": jet(mode=6),
            },
        ),
        (
            codec.emit_ecu_status,
            {
                **{f"{name} = 65536": status(**{name: 65536}) for name in ("overruns", "missed", "crc_errors")},
                **{f"{name} = -1": status(**{name: -1}) for name in ("missed", "refused", "not_authentic")},
                **{f"{name} = 256": status(**{name: 256}) for name in ("bus_off", "tx_errors", "rx_errors")},
                "set_aside = 16: must be in 0..15": status(set_aside=16),
                "bundle_hash": status(bundle_hash=2**32),
                "9 is not a valid Mode": status(state=9),
                "15 is not a valid Reason": status(reason=15),
            },
        ),
    ]
    for emit, messages in cases:
        for culprit, message in messages.items():
            with refused(ValueError, culprit):
                emit(message)
