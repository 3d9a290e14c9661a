"""The codecs of all sets: rounding, limits, what eight bytes leave out, and what is refused.

Against cantools: `test_whole_range` tries the values one by one, `tools/test_signals` and `tools/test_encode` any
message.
"""

import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from can_bridge.wire import classic_codec, codec
from can_bridge.wire.classic_codec import STALE_NS
from can_bridge.wire.message_sets import CLASSIC, FD
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason, VehicleSpeed
from tests.can_bridge.wire.described import decoded, jet, pressure, speed, status
from tests.refused import refused

PARSERS: list[tuple[Callable[[bytes], Any], Callable[[Any], bytes], int]] = [
    (parse, emit, spec.length)
    for module, used in ((codec, FD), (classic_codec, CLASSIC))
    for parse, emit, spec in zip(
        (module.parse_pressure, module.parse_vehicle_speed, module.parse_jet_command, module.parse_ecu_status),
        (module.emit_pressure, module.emit_vehicle_speed, module.emit_jet_command, module.emit_ecu_status),
        used.specs,
        strict=True,
    )
]


def pressures(largest: float) -> st.SearchStrategy[Pressure]:
    """Half a step beyond the last step still rounds to it; these stay clear of the ties."""
    return st.builds(
        Pressure,
        pressure_pa=st.tuples(*[st.floats(-largest, largest)] * 4),
        valid=st.tuples(*[st.booleans()] * 4),
        enable_request=st.booleans(),
        age_ns=st.integers(0, 655_354_999),
    )


@given(pressures(3276.74))
@example(pressure(pressure_pa=(-3276.8, 3276.7, 0.05, -0.0), enable_request=True, age_ns=655_350_000))
def test_emitted_pressure_is_rounded_to_the_nearest_step(message):
    signals = decoded("Pressure", codec.emit_pressure(message))
    for i in range(4):
        assert signals[f"Pressure{i}"] == pytest.approx(message.pressure_pa[i], abs=0.05 + 1e-9)
        assert signals[f"Valid{i}"] == message.valid[i]
    assert signals["EnableRequest"] == message.enable_request
    assert signals["Age"] == pytest.approx(message.age_ns / 1e6, abs=0.005 + 1e-9)


@given(pressures(2047.49))
def test_emitted_classic_pressure_is_rounded_and_looks_no_fresher_than_it_is(message):
    data = classic_codec.emit_pressure(message)
    signals = decoded("PressureClassic", data)
    for i in range(4):
        wanted = message.pressure_pa[i] if message.valid[i] else -2048
        assert signals[f"Pressure{i}"] == pytest.approx(wanted, abs=0.5)
    assert signals["EnableRequest"] == message.enable_request
    assert signals["Age"] == min(70, 10 * math.ceil(message.age_ns / 10**7))
    parsed = classic_codec.parse_pressure(data)
    assert parsed is not None
    assert parsed.age_ns >= min(message.age_ns, STALE_NS)
    assert parsed.valid == message.valid


@given(
    message=st.builds(
        VehicleSpeed,
        speed_m_per_s=st.none() | st.floats(0, 327.6724),
        age_ns=st.integers(0, 655_354_999) | st.integers(0, 10**12),
        density_kg_per_m3=st.none() | st.floats(0.0051, 2.5549),
    )
)
@example(speed(speed_m_per_s=327.67, age_ns=655_350_000, density_kg_per_m3=2.55))
@example(speed(speed_m_per_s=None, age_ns=2_540_000_001))
def test_a_speed_is_rounded_and_unknown_is_no_speed(message):
    """The classic set saturates an age and rounds it up; the other one refuses an age beyond its field."""
    steps = 655_350_000 if message.age_ns > 655_354_999 else message.age_ns
    for name, data, age_ms, half_ms in (
        ("VehicleSpeed", codec.emit_vehicle_speed(message._replace(age_ns=steps)), steps / 1e6, 0.005),
        ("VehicleSpeedClassic", classic_codec.emit_vehicle_speed(message),
         min(2550, 10 * math.ceil(message.age_ns / 10**7)), 0.0),
    ):  # fmt: skip
        signals = decoded(name, data)
        wanted = 327.675 if message.speed_m_per_s is None else message.speed_m_per_s
        assert signals["Speed"] == pytest.approx(wanted, abs=0.0025 + 1e-9)
        assert signals["AirDensity"] == pytest.approx(message.density_kg_per_m3 or 0.0, abs=0.005 + 1e-9)
        assert signals["Age"] == pytest.approx(age_ms, abs=half_ms + 1e-9)
        parsed = (codec if name == "VehicleSpeed" else classic_codec).parse_vehicle_speed(data)
        assert parsed is not None
        assert (parsed.speed_m_per_s is None) == (message.speed_m_per_s is None)
        assert (parsed.density_kg_per_m3 is None) == (message.density_kg_per_m3 is None)


@given(
    message=st.builds(
        JetCommand,
        flow_m2_per_s=st.floats(-6.55368, 6.55348),
        mode=st.sampled_from(Mode),
        enable=st.booleans(),
        pressure_counter=st.none() | st.integers(0, 15),
        next_period=st.booleans(),
    )
)
def test_a_command_has_the_same_rounded_flow_in_both_sets(message):
    """The command gate works in steps of the wire and need not know the set."""
    signals = decoded("JetCommand", codec.emit_jet_command(message))
    assert signals["Flow"] == pytest.approx(message.flow_m2_per_s, abs=0.0001 + 1e-12)
    classic = classic_codec.parse_jet_command(classic_codec.emit_jet_command(message))
    assert classic == codec.parse_jet_command(codec.emit_jet_command(message))
    assert classic is not None
    assert classic[1:] == message[1:]


@given(data=st.binary(max_size=70) | st.sampled_from([8, 16, 24]).flatmap(lambda n: st.binary(min_size=n, max_size=n)))
def test_any_bytes_parse_to_none_or_to_a_message_that_survives(data):
    """Never raises on wire data, and what it returns can be sent again and means the same."""
    for parse, emit, length in PARSERS:
        message = parse(data)
        assert message is None or parse(emit(message)) == message, parse
        assert message is None or len(data) == length, parse


def test_only_the_messages_own_length_parses_and_zeros_stay_zeros():
    for parse, emit, own in PARSERS:
        assert [length for length in range(70) if parse(bytes(length)) is not None] == [own], parse
        assert emit(parse(bytes(own))) == bytes(own), parse


def test_values_outside_a_table_are_malformed():
    _, _, (command, _, _), (state, _, _), _, _, (classic_command, _, _), (classic_state, _, _) = PARSERS
    for parse, size, shift, bad in (
        *((command, 8, 24, (6, 7)), (state, 24, 24, range(6, 16)), (state, 24, 32, range(18, 256))),
        *((classic_command, 8, 12, (6, 7)), (classic_state, 8, 12, (6, 7)), (classic_state, 8, 15, range(18, 32))),
    ):
        assert parse(bytes(size)) is not None, parse
        assert not [value for value in bad if parse((value << shift).to_bytes(size, "little")) is not None], parse


def test_a_sensor_that_is_not_valid_loses_its_value_and_no_other_does():
    message = pressure(pressure_pa=(-2047.0, 1.0, 2047.0, 5.0), valid=(True, False, True, True), age_ns=10_000_000)
    parsed = classic_codec.parse_pressure(classic_codec.emit_pressure(message))
    assert parsed == message._replace(pressure_pa=(-2047.0, 0.0, 2047.0, 5.0))
    whole = message._replace(valid=(True,) * 4)
    assert classic_codec.parse_pressure(classic_codec.emit_pressure(whole)) == whole


def test_classic_counts_stay_at_their_largest_values_and_the_hash_loses_its_lower_half():
    full = EcuStatus(
        state=Mode.FAULT, reason=Reason.CLOCK, overruns=65535, missed=64, crc_errors=1000, refused=63, bus_off=255,
        bundle_hash=0xD3061D50, not_authentic=5, tx_errors=255, rx_errors=127, set_aside=0b1010,
    )  # fmt: skip
    parsed = classic_codec.parse_ecu_status(classic_codec.emit_ecu_status(full))
    assert parsed == EcuStatus(
        state=Mode.FAULT, reason=Reason.CLOCK, overruns=63, missed=63, crc_errors=63, refused=63, bus_off=15,
        bundle_hash=0xD3060000,
    )  # fmt: skip


EMITS = {Pressure: "emit_pressure", VehicleSpeed: "emit_vehicle_speed", JetCommand: "emit_jet_command"}


def test_what_the_wire_cannot_carry_is_refused_by_name():
    cases: dict[Any, dict[str, Any]] = {
        codec: {
            "pressure_pa has 3 values": pressure(pressure_pa=(0.0,) * 3),
            "valid has 1 values": pressure(valid=(True,)),
            r"pressure_pa.* = nan: must be finite": pressure(pressure_pa=(0.0, math.nan, 0.0, 0.0)),
            r"3276\.76: must be in -3276\.8\.\.3276\.7": pressure(pressure_pa=(3276.76, 0.0, 0.0, 0.0)),
            r"1e\+300": pressure(pressure_pa=(1e300, 0.0, 0.0, 0.0)),
            "age_ns = -5001": pressure(age_ns=-5_001),
            "age_ns = 655355000": pressure(age_ns=655_355_000),
            "speed_m_per_s = nan: must be finite": speed(speed_m_per_s=math.nan),
            r"speed_m_per_s = -0\.1: must be in 0\.\.327\.67": speed(speed_m_per_s=-0.1),
            r"speed_m_per_s = 327\.673: must": speed(speed_m_per_s=327.673),  # which would be 0xFFFF
            r"density_kg_per_m3 = 0\.0: must be in 0\.01\.\.2\.55": speed(density_kg_per_m3=0.0),
            r"density_kg_per_m3 = 2\.6": speed(density_kg_per_m3=2.6),
            r"VehicleSpeed\.age_ns = 655355000": speed(age_ns=655_355_000),
            "flow_m2_per_s = -inf": jet(flow_m2_per_s=-math.inf),
            r"flow_m2_per_s = 6\.5536": jet(flow_m2_per_s=6.5536),
            "pressure_counter = 256": jet(pressure_counter=256),
            "pressure_counter = -1": jet(pressure_counter=-1),
            "6 is not a valid Mode": jet(mode=6),
            **{f"{name} = 65536": status(**{name: 65536}) for name in ("overruns", "missed", "crc_errors")},
            **{f"{name} = -1": status(**{name: -1}) for name in ("missed", "refused", "not_authentic")},
            **{f"{name} = 256": status(**{name: 256}) for name in ("bus_off", "tx_errors", "rx_errors")},
            "set_aside = 16: must be in 0..15": status(set_aside=16),
            "bundle_hash": status(bundle_hash=2**32),
            "9 is not a valid Mode": status(state=9),
            "18 is not a valid Reason": status(reason=18),
        },
        classic_codec: {
            "valid has 5 values": pressure(valid=(True,) * 5),
            "nan: must be finite": pressure(pressure_pa=(math.nan, 0.0, 0.0, 0.0)),
            r"2047\.6: must be in -2047\.\.2047": pressure(pressure_pa=(2047.6, 0.0, 0.0, 0.0)),
            r"-2048\.0: must be in": pressure(pressure_pa=(-2048.0, 0.0, 0.0, 0.0)),
            r"Pressure.*age_ns = -1: must not be negative": pressure(age_ns=-1),
            r"VehicleSpeed.*age_ns = -1: must not be negative": speed(age_ns=-1),
            r"speed_m_per_s = 327\.673: must": speed(speed_m_per_s=327.673),
            r"density_kg_per_m3 = -1: must": speed(density_kg_per_m3=-1),
            "flow_m2_per_s = 6.6": jet(flow_m2_per_s=6.6),
            r"pressure_counter = 16: must be in 0\.\.15": jet(pressure_counter=16),
            "missed = -1": status(missed=-1),
            "bundle_hash": status(bundle_hash=2**32),
        },
    }
    for codec_used, messages in cases.items():
        for culprit, message in messages.items():
            with refused(ValueError, culprit):
                getattr(codec_used, EMITS.get(type(message), "emit_ecu_status"))(message)
