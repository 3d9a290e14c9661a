"""The codecs of all sets: rounding, limits, what eight bytes leave out, and what is refused.

Against cantools: `test_whole_range` tries the values one by one, `tools/test_signals` and `tools/test_encode` any
message.
"""

import math
from collections.abc import Callable
from itertools import product
from typing import Any

import pytest

from can_bridge.wire import classic_codec, codec
from can_bridge.wire.classic_codec import STALE_NS
from can_bridge.wire.message_sets import CLASSIC, FD
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason, VehicleSpeed
from tests.can_bridge.wire.described import jet, pressure, speed, status
from tests.refused import refused

PARSERS: list[tuple[Callable[[bytes], Any], Callable[[Any], bytes], int]] = [
    (one.parse, one.emit, one.spec.length)
    for used in (FD, CLASSIC)
    for one in (used.pressure, used.speed, used.command, used.status)
]


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


def test_only_the_messages_own_length_parses_and_zeros_stay_zeros():
    for parse, emit, own in PARSERS:
        assert [length for length in range(70) if parse(bytes(length)) is not None] == [own], parse
        assert emit(parse(bytes(own))) == bytes(own), parse


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
