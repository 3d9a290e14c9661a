"""The variables of the ECU's FMU, each with the DBC signal that contains the variable's value. A variable's index in
the list is its value reference. The list is written as a table for the wrapper in C (`ecu/c/fmu/sw_fmu.c`), and as
`modelDescription.xml` (`firmware_sim.fmu.descriptions`)."""

import re
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Final, NamedTuple

from can_bridge.wire.message_sets import MessageSet, message_set
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from contract.release.checks import dbc_bytes
from firmware_sim.fmu.kinds import FmuKind

IDENTIFIER: Final = "stillwake_ecu"
CONTINUOUS: Final = "Float64"
SI_UNITS: Final[Mapping[str, Mapping[str, str]]] = {
    "Pa": {"kg": "1", "m": "-1", "s": "-2"},
    "m/s": {"m": "1", "s": "-1"},
    "m2/s": {"m": "2", "s": "-1"},
    "kg/m3": {"kg": "1", "m": "-3"},
    "s": {"s": "1"},
}
"""Definition of each unit: the exponents of its SI base units."""
ENUMERATIONS: Final[Mapping[str, type[IntEnum]]] = {"Mode": Mode, "Reason": Reason}
_C_TYPES: Final = {"Float64": "FLOAT64", "UInt32": "UINT32", "Boolean": "BOOLEAN", "Enumeration": "INT64"}
_C_TYPES_2: Final = _C_TYPES | {"UInt32": "INT32", "Enumeration": "INT32"}  # FMI 2.0 has only one integer type
_SIGNAL: Final = re.compile(r"^ SG_ (\w+) : (\d+)\|(\d+)@1([+-]) ", re.MULTILINE)
_VEHICLE: Final = """
pressure.*     | pressure.Pressure      | Float64     | Pa     | 0  | Wall pressure, relative to the free stream
valid.*        | pressure.Valid         | Boolean     |        | 1  | Whether the sensor reports itself as valid
enable_request | pressure.EnableRequest | Boolean     |        | 0  | Request for control, which has to rise
pressure_age   | pressure.Age           | Float64     | s      | 0  | Age of the pressures when they are sent
vehicle_speed  | speed.Speed            | Float64     | m/s    | 25 | Speed through the air; negative if unknown
air_density    | speed.AirDensity       | Float64     | kg/m3  | 0  | Density of the air; 0 if unknown
send_pressures |                        | Boolean     |        | 1  | Whether a Pressure frame is sent this period
send_speed     |                        | Boolean     |        | 1  | Whether a VehicleSpeed frame is sent this period
"""
"""Table of inputs: name, message.signal of a `MessageSet`, FMI 3.0 type, unit or enumeration, start, description."""
_BUS: Final = """
bus_notifications |  | Boolean | | 0 | Whether the bus confirms frames and reports errors and lost arbitration
step_offset       |  | Float64 | s | 0 | Time from the start to the ECU's first step, shorter than a control period
compute_time      |  | Float64 | s | 0 | Time from a step to the ECU's frames, shorter than a control period
"""
"""Table of the parameters of an FMU with a bus terminal, with the same columns as the table of inputs."""
_OUTPUTS: Final = """
flow_command   | command.Flow           | Float64     | m2/s   |    | Jet flow rate per unit span to be reached
next_period    | command.NextPeriod     | Boolean     |        |    | Whether the flow is for the next control period
enable         | command.Enable         | Boolean     |        |    | Whether the jets may run
mode           | command.Mode           | Enumeration | Mode   |    | Mode of the ECU
reason         | status.Reason          | Enumeration | Reason |    | Reason for which the ECU is not in control
overruns       | status.Overruns        | UInt32      |        |    | Control periods left out
missed         | status.Missed          | UInt32      |        |    | Control periods without usable pressures
crc_errors     | status.CrcErrors       | UInt32      |        |    | Pressure frames with a wrong CRC
refused        | status.Refused         | UInt32      |        |    | Pressure frames repeated or out of sequence
bus_off        | status.BusOff          | UInt32      |        |    | Times that the CAN controller was off the bus
set_aside.*    | status.SetAside        | Boolean     |        |    | Whether the ECU estimates this sensor's pressure
"""


class Variable(NamedTuple):
    """A variable of the FMU. A row of a table gives one variable, or one for each sensor if the name ends in `*`."""

    causality: str
    name: str
    message: str
    signal: str
    type: str
    unit: str
    start: str
    description: str


def ecu_variables(sensors: Sequence[str], config: Config, *, bus: bool = False) -> list[Variable]:
    """Return all variables in the order of their value references; `sensors` is in the order of the Pressure message.
    Outputs whose signal is not in the message set are left out. With `bus`, parameters replace the inputs."""
    starts = {
        "vehicle_speed": config.operating_point.speed,
        "step_offset": config.ecu.step_offset_ms / 1e3,
        "compute_time": config.ecu.compute_time_ms / 1e3,
    }
    signals = _signals(message_set(config.bus))
    found = [Variable("independent", "time", "", "", CONTINUOUS, "s", "", "Time")]
    side = ("parameter", _BUS) if bus else ("input", _VEHICLE)
    for causality, table in (side, ("output", _OUTPUTS)):
        for row in table.strip().splitlines():
            name, path, *rest = map(str.strip, row.split("|"))
            message, _, signal = path.partition(".")
            if name in starts:
                rest[2] = repr(starts[name])
            for i, sensor in enumerate(sensors if name.endswith("*") else [""]):
                names = name.replace("*", sensor), message, f"{signal}{i}" if sensor else signal
                item = Variable(causality, *names, *rest)
                if causality != "output" or item.signal in signals[message]:
                    found.append(item)
    return found


def wrapper_settings(variables: Sequence[Variable], token: str, config: Config, kind: FmuKind) -> bytes:
    """Return `sw_fmu_settings.h`, a header of the wrapper; `token` is the FMU's instantiation token."""
    messages, types = message_set(config.bus), _C_TYPES_2 if kind.fmi2 else _C_TYPES
    signals, rows = _signals(messages), []
    for item in variables:
        signal = signals.get(item.message, {}).get(item.signal, (0, 0, 0))
        message = item.message.upper() if item.causality == "output" else "NO_MESSAGE"
        scale = FLOW_RESOLUTION_M2_PER_S if item.signal == "Flow" else 1.0
        direction = item.causality.upper() if item.causality != "independent" else "OUTPUT"
        values = types[item.type], direction, item.start or 0, message, *signal, scale
        rows.append(f"    {{{', '.join(map(str, values))}}}, /* {item.name} */ \\")
    given = [(i, item.name) for i, item in enumerate(variables) if item.causality in ("input", "parameter")]
    # The references of `pressure` and `valid` are the first sensor's.
    first = {name.partition(".")[0]: i for i, name in reversed(given)}
    lines = [
        f'#define SW_FMU_TOKEN "{token}"',
        f"#define SW_FMU_BUS {int(kind.bus)}",
        f"#define SW_FMU_NOMINAL_BITRATE {config.bus.nominal_bitrate}",
        f"#define SW_FMU_DATA_BITRATE {config.bus.data_bitrate}",
        f"#define SW_FMU_PRESSURE_LIMIT {round(messages.pressure_limit_pa / messages.pressure_resolution_pa)}",
        f"#define SW_FMU_AGE_LIMIT {2 ** signals['pressure']['Age'][1] - 1}",
        *(f"#define SW_FMU_{name.upper()} {i}u" for name, i in first.items()),
        f"#define SW_FMU_VARIABLES {len(variables)}",
        "\n".join(["#define SW_FMU_TABLE { \\", *rows, "}"]),
    ]
    return "\n".join(["/* Generated: the variables of an FMU, and their signals. */", *lines, ""]).encode()


def _signals(messages: MessageSet) -> dict[str, dict[str, tuple[int, int, int]]]:
    """Return (first bit, number of bits, whether signed) by message (field of the set) and signal (name in the DBC)."""
    blocks, found = dbc_bytes().decode("utf-8").split("\nBO_ "), {}
    for message, spec in zip(("pressure", "speed", "command", "status"), messages.specs, strict=True):
        block = next(item for item in blocks if item.startswith(f"{spec.frame_id} {spec.name}:"))
        rows = _SIGNAL.findall(block)
        found[message] = {name: (int(start), int(bits), int(sign == "-")) for name, start, bits, sign in rows}
    return found
