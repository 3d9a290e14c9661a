"""The tables for the C library's examples: frames with a vehicle's pressures and speed, as C arrays."""

from typing import Final

from can_bridge.e2e.profiles import E2eSender
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import Freshness, secured
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import SPEED_RESOLUTION_M_PER_S, SPEED_UNKNOWN
from can_bridge.wire.messages import SENSORS, Pressure, VehicleSpeed
from contract.arrays import Array
from contract.config.tree import Config

PLAYED: Final = "examples/pressures.h"
MOST_PERIODS: Final = 100
"""Largest number of periods in a table: two seconds at 20 ms. Pressures take 1600 bytes of flash memory, speeds 800."""
PLAYED_KEY: Final = bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c")
"""Key of the frames if `bus.key` is set: the public key of RFC 4493's examples, so that no file has a secret."""
ASKED_FROM: Final = 5
"""Number of periods before the vehicle requests control: the ECU ignores a request that is present from the start."""


def played_pressures(rows: Array, config: Config) -> bytes:
    """Return `pressures.h`, with two protected frames for each of the first `MOST_PERIODS` rows: one has the pressures,
    limited to their range, the other the design speed (unknown if too high). The first S columns of `rows` are Cp."""
    messages = message_set(config.bus)
    message, limit_pa = messages.pressure, messages.pressure_limit_pa
    sender, dynamic_pressure = E2eSender(message.spec), config.operating_point.dynamic_pressure
    design, most = config.operating_point.speed, (SPEED_UNKNOWN - 1) * SPEED_RESOLUTION_M_PER_S
    speed = VehicleSpeed(speed_m_per_s=design if design <= most else None, age_ns=0, density_kg_per_m3=None)
    speed_sender, freshness = E2eSender(messages.speed.spec), Freshness()
    lines, speeds = list[str](), list[str]()
    key = Key(PLAYED_KEY) if message.spec.is_secured else None
    for period, row in enumerate(rows[:MOST_PERIODS, :SENSORS].tolist()):
        within = tuple(min(max(cp * dynamic_pressure, -limit_pa), limit_pa) for cp in row)
        pressure = Pressure(pressure_pa=within, valid=(True,) * SENSORS, enable_request=period >= ASKED_FROM, age_ns=0)
        played = (
            (lines, sender.frame(message.emit(pressure), now_ns=0), message.spec),
            (speeds, speed_sender.frame(messages.speed.emit(speed), now_ns=0), messages.speed.spec),
        )
        for rows_of, frame, spec in played:
            data = secured(frame, spec=spec, key=key, freshness=freshness).data
            rows_of.append("    {" + ", ".join(f"{byte:#04x}" for byte in data) + "}")
        freshness = freshness.next()
    pressure_table, speed_table = (",\n".join(rows_of) for rows_of in (lines, speeds))
    return (
        "/* Generated: the frames that a vehicle sends, one a control period, for the examples. */\n"
        "#ifndef PRESSURES_H\n#define PRESSURES_H\n\n"
        '#include "sw_ecu.h"\n\n'
        f"#define PRESSURE_PERIODS {len(lines)}u\n"
        f"#define PLAYED_KEY {{{', '.join(map(str, PLAYED_KEY))}}} /* from RFC 4493's examples */\n\n"
        f"static const uint8_t pressures[PRESSURE_PERIODS][{message.spec.length}] = {{\n{pressure_table}}};\n\n"
        "/* The design speed, for a release with a range of speeds. */\n#if SW_PAST > 0\n"
        f"static const uint8_t speeds[PRESSURE_PERIODS][{messages.speed.spec.length}] = {{\n{speed_table}}};\n"
        "#endif\n\n#endif\n"
    ).encode()
