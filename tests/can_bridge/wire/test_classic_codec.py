"""What the eight bytes of the classic set leave out, by hand; what all sets share stands in `test_codec`."""

import math
from collections.abc import Callable
from typing import Any

from can_bridge.wire import classic_codec
from can_bridge.wire.messages import EcuStatus, Mode, Reason
from tests.can_bridge.wire.described import jet, pressure, speed, status
from tests.refused import refused


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


def test_what_eight_bytes_cannot_carry_is_refused_by_name():
    cases: list[tuple[Callable[[Any], bytes], dict[str, Any]]] = [
        (
            classic_codec.emit_pressure,
            {
                "valid has 5 values": pressure(valid=(True,) * 5),
                "nan: must be finite": pressure(pressure_pa=(math.nan, 0.0, 0.0, 0.0)),
                r"2047\.6: must be in -2047\.\.2047": pressure(pressure_pa=(2047.6, 0.0, 0.0, 0.0)),
                r"-2048\.0: must be in": pressure(pressure_pa=(-2048.0, 0.0, 0.0, 0.0)),
                "age_ns = -1: must not be negative": pressure(age_ns=-1),
            },
        ),
        (
            classic_codec.emit_vehicle_speed,
            {
                "age_ns = -1: must not be negative": speed(age_ns=-1),
                r"speed_m_per_s = 327\.673: must": speed(speed_m_per_s=327.673),
                r"density_kg_per_m3 = -1: must": speed(density_kg_per_m3=-1),
            },
        ),
        (
            classic_codec.emit_jet_command,
            {
                "flow_m2_per_s = 6.6": jet(flow_m2_per_s=6.6),
                r"pressure_counter = 16: must be in 0\.\.15": jet(pressure_counter=16),
            },
        ),
        (classic_codec.emit_ecu_status, {"missed = -1": status(missed=-1), "bundle_hash": status(bundle_hash=2**32)}),
    ]
    for emit, messages in cases:
        for culprit, message in messages.items():
            with refused(ValueError, culprit):
                emit(message)
