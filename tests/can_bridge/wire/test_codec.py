"""Both directions against cantools reading the DBC."""

import math
from importlib.resources import files
from typing import Any

import pytest
from cantools.database import Database
from hypothesis import example, given
from hypothesis import strategies as st

from can_bridge.wire import codec
from can_bridge.wire.message_sets import FD
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason

DBC = Database()
DBC.add_dbc_string(files("contract").joinpath("stillwake.dbc").read_text())

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


def decoded(name: str, data: bytes) -> dict:
    signals = DBC.decode_message(name, data, decode_choices=False)
    assert isinstance(signals, dict)
    return signals


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


@given(STATUSES)
def test_emitted_status_means_the_same_to_cantools(message):
    signals = decoded("EcuStatus", codec.emit_ecu_status(message))
    assert signals == {
        "E2E_CRC": 0, "E2E_Counter": 0, "State": message.state, "Reason": message.reason, "BusOff": message.bus_off,
        "Overruns": message.overruns, "Missed": message.missed, "CrcErrors": message.crc_errors,
        "BundleHash": message.bundle_hash, "Refused": message.refused, "NotAuthentic": message.not_authentic,
        "TxErrors": message.tx_errors, "RxErrors": message.rx_errors,
        **{f"SetAside{i}": message.set_aside >> i & 1 for i in range(4)},
    }  # fmt: skip


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


ROUND_TRIPS = [
    (codec.parse_pressure, codec.emit_pressure),
    (codec.parse_jet_command, codec.emit_jet_command),
    (codec.parse_ecu_status, codec.emit_ecu_status),
]


@pytest.mark.parametrize(("parse", "emit"), ROUND_TRIPS)
@given(
    data=st.binary(max_size=70)
    | st.binary(min_size=8, max_size=8)
    | st.binary(min_size=16, max_size=16)
    | st.binary(min_size=24, max_size=24)
)
def test_any_bytes_parse_to_none_or_to_a_message_that_survives(parse, emit, data):
    """Never raises on wire data, and what it returns can be sent again and means the same."""
    message = parse(data)
    if message is not None:
        assert parse(emit(message)) == message


@pytest.mark.parametrize(("parse", "spec"), [(pair[0], spec) for pair, spec in zip(ROUND_TRIPS, FD.specs, strict=True)])
def test_only_the_messages_own_length_parses(parse, spec):
    assert [length for length in range(70) if parse(bytes(length)) is not None] == [spec.length]


@pytest.mark.parametrize(
    ("parse", "size", "byte", "bad"),
    [
        (codec.parse_jet_command, 8, 3, [6, 7]),
        (codec.parse_ecu_status, 24, 3, range(6, 16)),
        (codec.parse_ecu_status, 24, 4, range(15, 256)),
    ],
)
def test_values_outside_a_table_are_malformed(parse, size, byte, bad):
    for value in bad:
        data = bytearray(size)
        data[byte] = value
        assert parse(bytes(data)) is None


def test_bits_without_a_signal_are_ignored():
    pressure, jet, status = bytearray(16), bytearray(8), bytearray(24)
    expected = [parse(bytes(data)) for (parse, _), data in zip(ROUND_TRIPS, (pressure, jet, status), strict=True)]
    pressure[3], pressure[14], pressure[15] = 0b1110_0000, 0xFF, 0xFF
    jet[3], jet[6], jet[7] = 0b1100_0000, 0xFF, 0xFF  # byte 6 echoes a counter that is flagged as not valid
    status[3], status[22], status[23] = 0b1111_0000, 0xF0, 0xFF
    got = [parse(bytes(data)) for (parse, _), data in zip(ROUND_TRIPS, (pressure, jet, status), strict=True)]
    assert got == expected


def pressure(**changes: Any) -> Pressure:
    fields: dict[str, Any] = {"pressure_pa": (0.0,) * 4, "valid": (True,) * 4, "enable_request": False, "age_ns": 0}
    return Pressure(**{**fields, **changes})


def jet(**changes: Any) -> JetCommand:
    fields: dict[str, Any] = {"flow_m2_per_s": 0.0, "mode": Mode.OFF, "enable": False, "pressure_counter": None}
    return JetCommand(**{**fields, **changes})


def status(**changes: Any) -> EcuStatus:
    fields: dict[str, Any] = {"state": Mode.OFF, "reason": Reason.NONE}
    counts = dict.fromkeys(("overruns", "missed", "crc_errors", "bus_off", "bundle_hash"), 0)
    return EcuStatus(**{**fields, **counts, **changes})


@pytest.mark.parametrize(
    ("emit", "message", "culprit"),
    [
        (codec.emit_pressure, pressure(pressure_pa=(0.0,) * 3), "pressure_pa has 3 values"),
        (codec.emit_pressure, pressure(pressure_pa=(0.0,) * 5), "pressure_pa has 5 values"),
        (codec.emit_pressure, pressure(valid=(True,)), "valid has 1 values"),
        (codec.emit_pressure, pressure(pressure_pa=(0.0, math.nan, 0.0, 0.0)), "nan: must be finite"),
        (codec.emit_pressure, pressure(pressure_pa=(0.0, 0.0, 0.0, math.inf)), "inf: must be finite"),
        (
            codec.emit_pressure,
            pressure(pressure_pa=(3276.76, 0.0, 0.0, 0.0)),
            r"3276\.76: must be in -3276\.8\.\.3276\.7",
        ),
        (codec.emit_pressure, pressure(pressure_pa=(-3276.86, 0.0, 0.0, 0.0)), r"-3276\.86"),
        (codec.emit_pressure, pressure(pressure_pa=(1e300, 0.0, 0.0, 0.0)), r"1e\+300"),
        (codec.emit_pressure, pressure(age_ns=-5_001), "age_ns"),
        (codec.emit_pressure, pressure(age_ns=655_355_000), "age_ns"),
        (codec.emit_jet_command, jet(flow_m2_per_s=math.nan), "flow_m2_per_s = nan"),
        (codec.emit_jet_command, jet(flow_m2_per_s=-math.inf), "flow_m2_per_s = -inf"),
        (codec.emit_jet_command, jet(flow_m2_per_s=1e308), r"1e\+308: must be in"),
        (codec.emit_jet_command, jet(flow_m2_per_s=6.5536), r"flow_m2_per_s = 6\.5536"),
        (codec.emit_jet_command, jet(pressure_counter=256), "pressure_counter = 256"),
        (codec.emit_jet_command, jet(pressure_counter=-1), "pressure_counter = -1"),
        (codec.emit_jet_command, jet(mode=6), "6 is not a valid Mode"),
        (codec.emit_ecu_status, status(set_aside=16), "set_aside = 16: must be in 0..15"),
        (codec.emit_ecu_status, status(overruns=65536), "overruns = 65536"),
        (codec.emit_ecu_status, status(missed=-1), "missed = -1"),
        (codec.emit_ecu_status, status(crc_errors=65536), "crc_errors = 65536"),
        (codec.emit_ecu_status, status(bus_off=256), "bus_off = 256"),
        (codec.emit_ecu_status, status(bundle_hash=2**32), "bundle_hash"),
        (codec.emit_ecu_status, status(state=9), "9 is not a valid Mode"),
        (codec.emit_ecu_status, status(reason=15), "15 is not a valid Reason"),
        (codec.emit_ecu_status, status(refused=65536), "refused = 65536"),
        (codec.emit_ecu_status, status(not_authentic=-1), "not_authentic = -1"),
        (codec.emit_ecu_status, status(tx_errors=256), "tx_errors = 256"),
        (codec.emit_ecu_status, status(rx_errors=256), "rx_errors = 256"),
    ],
)
def test_what_the_wire_cannot_carry_is_refused_by_name(emit, message, culprit):
    with pytest.raises(ValueError, match=culprit):
        emit(message)
