"""Every signal of the messages in C against the DBC as cantools reads it, and the meaning against the Python codec."""

from importlib.resources import files

import pytest
from cantools.database import Database
from hypothesis import assume, given
from hypothesis import strategies as st

from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Reason

DBC = Database()
DBC.add_dbc_string(files("contract").joinpath("stillwake.dbc").read_text())

COUNTS = st.one_of(st.integers(0, 300), st.integers(0, 2**32 - 1))
INVALID_STEPS = -2048
"""Of a pressure in the classic set, by the DBC's table of values."""


def decoded(spec, data: bytes, *, scaling: bool = False) -> dict[str, float]:
    found = DBC.decode_message(spec.name, data, decode_choices=False, scaling=scaling)
    assert isinstance(found, dict)
    return {name: value for name, value in found.items() if isinstance(value, int | float)}


def parsed(parts, data: bytes):
    pressure = parts.ffi.new("sw_pressure *")
    parts.lib.sw_parse_pressure(parts.ffi.from_buffer("uint8_t[]", data), pressure)
    return pressure


def emitted(parts, name: str, length: int, message) -> bytes:
    # Whatever stood there before must not go out.
    buffer = parts.ffi.new("uint8_t[]", b"\xa5" * length)
    getattr(parts.lib, name)(buffer, message)
    return bytes(parts.ffi.buffer(buffer, length))


@given(data=st.binary(min_size=16, max_size=16))
def test_pressures_are_read_as_cantools_reads_them(parts, data):
    spec = parts.messages.pressure.spec
    data = data[: spec.length]
    signals, found = decoded(spec, data), parsed(parts, data)
    valid = [signals.get(f"Valid{i}", signals[f"Pressure{i}"] != INVALID_STEPS) for i in range(4)]
    for i in range(4):
        kept = spec.is_fd or valid[i]
        assert found.pressure_pa[i] == (signals[f"Pressure{i}"] * parts.messages.pressure_resolution_pa if kept else 0)
    assert [found.valid >> i & 1 for i in range(8)] == [*map(int, valid), 0, 0, 0, 0]
    assert found.enable_request == signals["EnableRequest"]
    # In ms; the DBC says that the classic set's last step means too old to act on.
    age = decoded(spec, data, scaling=True)["Age"]
    if spec.is_fd or signals["Age"] < 7:
        assert found.age_ns == round(age * 1e6)
    else:
        assert found.age_ns > parts.config.ecu.hold_periods * parts.config.period_ns + 70_000_000


@given(data=st.data())
def test_pressures_that_cantools_wrote_are_read_back(parts, data):
    spec = parts.messages.pressure.spec
    message = DBC.get_message_by_name(spec.name)
    raw = {
        signal.name: data.draw(
            st.integers(-(1 << signal.length - 1), (1 << signal.length - 1) - 1)
            if signal.is_signed
            else st.integers(0, (1 << signal.length) - 1)
        )
        for signal in message.signals
    }
    wire = message.encode(raw, scaling=False)
    found = parsed(parts, wire)
    expected = parts.messages.pressure.parse(wire)
    assert expected is not None
    assert tuple(found.pressure_pa) == expected.pressure_pa
    assert tuple(bool(found.valid >> i & 1) for i in range(4)) == expected.valid
    assert (bool(found.enable_request), found.age_ns) == (expected.enable_request, expected.age_ns)
    assert parts.lib.sw_e2e_counter(parts.ffi.from_buffer("uint8_t[]", wire)) == raw["E2E_Counter"]


@given(
    flow=st.integers(-32768, 32767),
    mode=st.sampled_from(Mode),
    enable=st.booleans(),
    counter=st.none() | st.integers(0, 255),
)
def test_a_command_is_what_cantools_reads(parts, flow, mode, enable, counter):
    spec = parts.messages.command.spec
    if counter is not None:
        counter %= profile_of(spec).counter_period
    command = {"flow": flow, "mode": mode, "enable": enable, "has_counter": counter is not None}
    # A counter that is none is not sent.
    command["pressure_counter"] = 9 if counter is None else counter
    wire = emitted(parts, "sw_emit_command", spec.length, parts.ffi.new("sw_jet_command *", command))
    assert decoded(spec, wire) == {
        "E2E_CRC": 0,
        "E2E_Counter": 0,
        "Mode": mode.value,
        "Enable": enable,
        "PressureCounterValid": counter is not None,
        "NextPeriod": parts.config.ecu.plan_ahead,
        "Flow": flow,
        "PressureCounter": counter or 0,
    }
    resolution = decoded(spec, wire, scaling=True)["Flow"]
    message = JetCommand(
        flow_m2_per_s=resolution,
        mode=mode,
        enable=enable,
        pressure_counter=counter,
        next_period=parts.config.ecu.plan_ahead,
    )
    assert parts.messages.command.emit(message) == wire


@given(
    state=st.sampled_from(Mode),
    reason=st.sampled_from(Reason),
    aside=st.integers(0, 15),
    counts=st.tuples(*[COUNTS] * 7),
)
def test_a_status_is_what_cantools_reads(parts, state, reason, aside, counts):
    spec = parts.messages.status.spec
    names = ("overruns", "missed", "crc_errors", "refused", "bus_off", "tx_errors", "rx_errors")
    status = {"state": state, "reason": reason, "set_aside": aside, **dict(zip(names, counts, strict=True))}
    wire = emitted(parts, "sw_emit_status", spec.length, parts.ffi.new("sw_ecu_status *", status))
    found = decoded(spec, wire)
    message = DBC.get_message_by_name(spec.name)
    largest = {signal.name: (1 << signal.length) - 1 for signal in message.signals}
    signals = ("Overruns", "Missed", "CrcErrors", "Refused", "BusOff", "TxErrors", "RxErrors")
    for signal, count in zip(signals, counts, strict=True):
        if signal in largest:
            assert found.pop(signal) == min(count, largest[signal])
    # All of it in CAN FD; its first two bytes in classic CAN.
    bits = message.get_signal_by_name("BundleHash").length
    assert found.pop("BundleHash") == parts.bundle.short_hash >> 32 - bits
    expected = {"E2E_CRC": 0, "E2E_Counter": 0, "State": state.value, "Reason": reason.value}
    if spec.is_fd:
        expected |= {"NotAuthentic": 0} | {f"SetAside{i}": aside >> i & 1 for i in range(4)}
    assert found == expected


@given(counts=st.tuples(*[st.integers(0, 255)] * 7))
def test_a_status_is_the_python_codecs(parts, counts):
    assume(parts.bundle.short_hash)
    names = ("overruns", "missed", "crc_errors", "refused", "bus_off", "tx_errors", "rx_errors")
    values = dict(zip(names, counts, strict=True))
    message = EcuStatus(
        state=Mode.HOLD, reason=Reason.STALE, bundle_hash=parts.bundle.short_hash, set_aside=5, **values
    )
    status = parts.ffi.new("sw_ecu_status *", {"state": 3, "reason": 7, "set_aside": 5, **values})
    spec = parts.messages.status.spec
    assert emitted(parts, "sw_emit_status", spec.length, status) == parts.messages.status.emit(message)


@pytest.mark.parametrize("message", ["command", "status"])
def test_a_message_of_zeros_is_one_of_zeros(parts, message):
    """But for what the release and the vehicle put into it."""
    if message == "command":
        wire = emitted(parts, "sw_emit_command", parts.messages.command.spec.length, parts.ffi.new("sw_jet_command *"))
        signals = decoded(parts.messages.command.spec, wire)
        assert signals.pop("NextPeriod") == parts.config.ecu.plan_ahead
    else:
        wire = emitted(parts, "sw_emit_status", parts.messages.status.spec.length, parts.ffi.new("sw_ecu_status *"))
        signals = decoded(parts.messages.status.spec, wire)
        signals.pop("BundleHash")
    assert not any(signals.values())
