"""The classic set: both directions against cantools reading the DBC, and what eight bytes leave out."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire import classic_codec, codec
from can_bridge.wire.classic_codec import STALE_NS
from can_bridge.wire.message_sets import CLASSIC
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason
from tests.can_bridge.wire.described import DBC, decoded, jet, pressure, status
from tests.refused import refused

U4, U6, U16 = (st.integers(0, 2**bits - 1) for bits in (4, 6, 16))
PRESSURES = st.builds(
    Pressure,
    # Clear of the ties at half a step.
    pressure_pa=st.tuples(*[st.floats(-2047.49, 2047.49)] * 4),
    valid=st.tuples(*[st.booleans()] * 4),
    enable_request=st.booleans(),
    age_ns=st.integers(0, 10**10),
)


@given(PRESSURES)
def test_emitted_pressure_means_the_same_to_cantools(message):
    signals = decoded("PressureClassic", classic_codec.emit_pressure(message))
    for i in range(4):
        if message.valid[i]:
            assert signals[f"Pressure{i}"] == pytest.approx(message.pressure_pa[i], abs=0.5)
        else:
            assert signals[f"Pressure{i}"] == -2048
    assert signals["EnableRequest"] == message.enable_request
    assert signals["Age"] == min(70, 10 * math.ceil(message.age_ns / 10**7))
    assert (signals["E2E_CRC"], signals["E2E_Counter"]) == (0, 0)


@given(PRESSURES)
def test_no_frame_looks_fresher_than_it_is(message):
    parsed = classic_codec.parse_pressure(classic_codec.emit_pressure(message))
    assert parsed is not None
    assert parsed.age_ns >= min(message.age_ns, STALE_NS)


def test_a_sensor_that_is_not_valid_loses_its_value_and_no_other_does():
    message = pressure(pressure_pa=(-2047.0, 1.0, 2047.0, 5.0), valid=(True, False, True, True), age_ns=10_000_000)
    signals = decoded("PressureClassic", classic_codec.emit_pressure(message))
    assert [signals[f"Pressure{i}"] for i in range(4)] == [-2047, -2048, 2047, 5]
    parsed = classic_codec.parse_pressure(classic_codec.emit_pressure(message))
    assert parsed == message._replace(pressure_pa=(-2047.0, 0.0, 2047.0, 5.0))
    whole = message._replace(valid=(True,) * 4)
    assert classic_codec.parse_pressure(classic_codec.emit_pressure(whole)) == whole


@given(data=st.data())
def test_pressure_encoded_by_cantools_is_parsed(data):
    raw = data.draw(st.tuples(*[st.integers(-2048, 2047)] * 4))
    enable, age = data.draw(st.booleans()), data.draw(st.integers(0, 7))
    signals = {f"Pressure{i}": raw[i] for i in range(4)}
    signals |= {"EnableRequest": enable, "Age": 10 * age, "E2E_CRC": data.draw(st.integers(0, 255)), "E2E_Counter": 9}
    parsed = classic_codec.parse_pressure(DBC.encode_message("PressureClassic", signals, strict=False))
    assert parsed is not None
    assert parsed.valid == tuple(value != -2048 for value in raw)
    assert parsed.pressure_pa == tuple(0.0 if value == -2048 else float(value) for value in raw)
    assert (parsed.enable_request, parsed.age_ns) == (enable, STALE_NS if age == 7 else age * 10_000_000)


@given(
    flow=st.integers(-0x8000, 0x7FFF),
    mode=st.sampled_from(Mode),
    enable=st.booleans(),
    echo=st.none() | U4,
    crc=U4,
    later=st.booleans(),
)
def test_jet_command_is_the_same_to_cantools_in_both_directions(flow, mode, enable, echo, crc, later):
    signals = {
        "Flow": flow * 0.0002, "Mode": mode.value, "Enable": int(enable), "PressureCounterValid": int(echo is not None),
        "PressureCounter": echo or 0, "E2E_CRC": crc, "E2E_Counter": 7, "NextPeriod": int(later),
    }  # fmt: skip
    parsed = classic_codec.parse_jet_command(DBC.encode_message("JetCommandClassic", signals, strict=False))
    assert parsed is not None
    assert parsed.flow_m2_per_s == pytest.approx(flow / 5000)
    assert parsed[1:] == (mode, enable, echo, later)
    back = decoded("JetCommandClassic", classic_codec.emit_jet_command(parsed))
    assert back == pytest.approx(signals | {"E2E_CRC": 0, "E2E_Counter": 0})


@given(
    message=st.builds(
        EcuStatus,
        state=st.sampled_from(Mode),
        reason=st.sampled_from(Reason),
        overruns=U6,
        missed=U6,
        crc_errors=U6,
        refused=U6,
        bus_off=U4,
        bundle_hash=U16.map(lambda upper: upper << 16),
        not_authentic=st.just(0),
        tx_errors=st.just(0),
        rx_errors=st.just(0),
        set_aside=st.just(0),
    )
)
def test_status_is_the_same_to_cantools_in_both_directions(message):
    signals = {
        "E2E_CRC": 0, "E2E_Counter": 0, "State": message.state.value, "Reason": message.reason.value,
        "BusOff": message.bus_off, "Overruns": message.overruns, "Missed": message.missed,
        "CrcErrors": message.crc_errors, "Refused": message.refused, "BundleHash": message.bundle_hash >> 16,
    }  # fmt: skip
    assert decoded("EcuStatusClassic", classic_codec.emit_ecu_status(message)) == signals
    assert classic_codec.parse_ecu_status(DBC.encode_message("EcuStatusClassic", signals)) == message


def test_counts_stay_at_their_largest_values_and_the_hash_loses_its_lower_half():
    full = EcuStatus(
        state=Mode.FAULT, reason=Reason.CLOCK, overruns=65535, missed=64, crc_errors=1000, refused=63, bus_off=255,
        bundle_hash=0xD3061D50, not_authentic=5, tx_errors=255, rx_errors=127, set_aside=0b1010,
    )  # fmt: skip
    parsed = classic_codec.parse_ecu_status(classic_codec.emit_ecu_status(full))
    assert parsed == EcuStatus(
        state=Mode.FAULT, reason=Reason.CLOCK, overruns=63, missed=63, crc_errors=63, refused=63, bus_off=15,
        bundle_hash=0xD3060000,
    )  # fmt: skip


@given(
    message=st.builds(
        JetCommand,
        flow_m2_per_s=st.floats(-6.5536, 6.5534),
        mode=st.sampled_from(Mode),
        enable=st.booleans(),
        pressure_counter=st.none() | U4,
        next_period=st.booleans(),
    )
)
def test_a_command_has_the_same_flow_in_both_sets(message):
    """The command gate works in steps of the wire and need not know the set."""
    classic = classic_codec.parse_jet_command(classic_codec.emit_jet_command(message))
    assert classic == codec.parse_jet_command(codec.emit_jet_command(message))


PARSERS: list[Callable[[bytes], Any]] = [
    classic_codec.parse_pressure,
    classic_codec.parse_jet_command,
    classic_codec.parse_ecu_status,
]
EMITTERS: list[Callable[[Any], bytes]] = [
    classic_codec.emit_pressure,
    classic_codec.emit_jet_command,
    classic_codec.emit_ecu_status,
]


@given(data=st.binary(max_size=70) | st.binary(min_size=8, max_size=8))
def test_any_bytes_parse_to_none_or_to_a_message_that_survives(data):
    for parse, emit in zip(PARSERS, EMITTERS, strict=True):
        message = parse(data)
        assert message is None or parse(emit(message)) == message, parse


def test_only_eight_bytes_parse():
    for parse, spec in zip(PARSERS, CLASSIC.specs, strict=True):
        assert [length for length in range(70) if parse(bytes(length)) is not None] == [spec.length] == [8], (
            parse,
            spec,
        )


def test_values_outside_a_table_are_malformed():
    for parse, shift, bad in [
        (PARSERS[1], 12, (6, 7)),
        (PARSERS[2], 12, range(6, 16)),
        (PARSERS[2], 16, range(15, 16)),
    ]:
        for value in bad:
            assert parse((value << shift).to_bytes(8, "little")) is None, (parse, shift, bad)


def test_bits_without_a_signal_are_ignored():
    spare = (0b11 << 34 | 0xFF_FFFF << 40).to_bytes(8, "little")
    assert PARSERS[1](spare) == PARSERS[1](bytes(8))


def test_what_the_wire_cannot_carry_is_refused_by_name():
    cases: list[tuple[Callable[[Any], bytes], Any, str]] = [
        (classic_codec.emit_pressure, pressure(pressure_pa=(0.0,) * 3), "pressure_pa has 3 values"),
        (classic_codec.emit_pressure, pressure(valid=(True,) * 5), "valid has 5 values"),
        (classic_codec.emit_pressure, pressure(pressure_pa=(math.nan, 0.0, 0.0, 0.0)), "nan: must be finite"),
        (classic_codec.emit_pressure, pressure(pressure_pa=(2047.6, 0.0, 0.0, 0.0)), r"must be in -2047\.\.2047"),
        (classic_codec.emit_pressure, pressure(pressure_pa=(-2048.0, 0.0, 0.0, 0.0)), r"-2048\.0: must be in"),
        (classic_codec.emit_pressure, pressure(age_ns=-1), "age_ns = -1: must not be negative"),
        (classic_codec.emit_jet_command, jet(flow_m2_per_s=6.6), "flow_m2_per_s = 6.6"),
        (classic_codec.emit_jet_command, jet(pressure_counter=16), r"pressure_counter = 16: must be in 0\.\.15"),
        (classic_codec.emit_ecu_status, status(missed=-1), "missed = -1: must not be negative"),
        (classic_codec.emit_ecu_status, status(bundle_hash=2**32), "bundle_hash"),
        (classic_codec.emit_ecu_status, status(reason=15), "15 is not a valid Reason"),
    ]
    for emit, message, culprit in cases:
        with refused(ValueError, culprit):
            emit(message)
