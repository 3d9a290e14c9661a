"""The variables of the ECU's FMU, each with the DBC signal that carries it.

A variable's place in the list is its value reference. The list is written as the table that the wrapper in C uses
(`ecu/c/fmu/sw_fmu.c`), and as `modelDescription.xml`.
"""

import re
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Final, NamedTuple
from xml.etree import ElementTree

from can_bridge.wire.message_sets import MessageSet, message_set
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from contract.release.checks import Bundle, dbc_bytes

IDENTIFIER: Final = "stillwake_ecu"
_UNITS: Final[Mapping[str, Mapping[str, str]]] = {
    "Pa": {"kg": "1", "m": "-1", "s": "-2"},
    "m/s": {"m": "1", "s": "-1"},
    "m2/s": {"m": "2", "s": "-1"},
    "kg/m3": {"kg": "1", "m": "-3"},
    "s": {"s": "1"},
}
"""Exponents of the SI base units in each unit."""
ENUMERATIONS: Final[Mapping[str, type[IntEnum]]] = {"Mode": Mode, "Reason": Reason}
_C_TYPES: Final = {"Float64": "FLOAT64", "UInt32": "UINT32", "Boolean": "BOOLEAN", "Enumeration": "INT64"}
_SIGNAL: Final = re.compile(r"^ SG_ (\w+) : (\d+)\|(\d+)@1([+-]) ", re.MULTILINE)


_TABLE: Final = """
time           |                        | Float64     | s      |    | Time
pressure.*     | pressure.Pressure      | Float64     | Pa     | 0  | Wall pressure, relative to the free stream
valid.*        | pressure.Valid         | Boolean     |        | 1  | Whether the sensor finds itself sound
enable_request | pressure.EnableRequest | Boolean     |        | 0  | Whether control is wanted; it has to rise
pressure_age   | pressure.Age           | Float64     | s      | 0  | Of the pressures when they are sent
vehicle_speed  | speed.Speed            | Float64     | m/s    | 25 | Through the air; below 0 where it is not known
air_density    | speed.AirDensity       | Float64     | kg/m3  | 0  | 0 where it is not known
send_pressures |                        | Boolean     |        | 1  | Whether this period's frame with pressures comes
send_speed     |                        | Boolean     |        | 1  | Whether this period's frame with the speed comes
flow_command   | command.Flow           | Float64     | m2/s   |    | Jet flow rate per unit span to be reached
next_period    | command.NextPeriod     | Boolean     |        |    | Reached in the next control period, not in this
enable         | command.Enable         | Boolean     |        |    | Whether the jets may run
mode           | command.Mode           | Enumeration | Mode   |    | What the ECU does
reason         | status.Reason          | Enumeration | Reason |    | Why it does not control
overruns       | status.Overruns        | UInt32      |        |    | Control periods left out
missed         | status.Missed          | UInt32      |        |    | Control periods without usable pressures
crc_errors     | status.CrcErrors       | UInt32      |        |    | Pressure frames with a wrong CRC
refused        | status.Refused         | UInt32      |        |    | Pressure frames repeated or out of sequence
bus_off        | status.BusOff          | UInt32      |        |    | Times that the CAN controller was off the bus
set_aside.*    | status.SetAside        | Boolean     |        |    | Whether the ECU estimates it by the others
"""
"""Columns: name, message and signal of a `MessageSet`, FMI 3.0 type, unit or enumeration, start, description."""


class Variable(NamedTuple):
    """A row of the table; a row for all sensors gives one variable per sensor."""

    name: str
    message: str
    signal: str
    type: str
    unit: str
    start: str
    description: str

    @property
    def causality(self) -> str:
        if self.name == "time":
            return "independent"
        return "input" if self.start else "output"


def ecu_variables(sensors: Sequence[str], config: Config) -> list[Variable]:
    """Return all variables in the order of their value references; `sensors` has the order of the Pressure message.

    An output whose signal the message set lacks is left out.
    """
    signals, found = _signals(message_set(config.bus)), list[Variable]()
    for row in _TABLE.strip().splitlines():
        name, path, *rest = map(str.strip, row.split("|"))
        message, _, signal = path.partition(".")
        if name == "vehicle_speed":
            rest[2] = repr(config.operating_point.speed)
        for i, sensor in enumerate(sensors if name.endswith("*") else [""]):
            item = Variable(name.replace("*", sensor), message, f"{signal}{i}" if sensor else signal, *rest)
            if item.causality != "output" or item.signal in signals[message]:
                found.append(item)
    return found


def wrapper_settings(variables: Sequence[Variable], token: str, config: Config) -> bytes:
    """Return `sw_fmu_settings.h`, with which the wrapper is compiled; `token` is the FMU's instantiation token."""
    messages = message_set(config.bus)
    signals, rows = _signals(messages), []
    for item in variables:
        signal = signals.get(item.message, {}).get(item.signal, (0, 0, 0))
        message = item.message.upper() if item.causality == "output" else "NO_MESSAGE"
        scale = FLOW_RESOLUTION_M2_PER_S if item.signal == "Flow" else 1.0
        values = _C_TYPES[item.type], int(item.causality == "input"), item.start or 0, message, *signal, scale
        rows.append(f"    {{{', '.join(map(str, values))}}}, /* {item.name} */ \\")
    lines = [
        f'#define SW_FMU_TOKEN "{token}"',
        f"#define SW_FMU_PRESSURE_LIMIT {round(messages.pressure_limit_pa / messages.pressure_resolution_pa)}",
        f"#define SW_FMU_AGE_LIMIT {2 ** signals['pressure']['Age'][1] - 1}",
        *(f"#define SW_FMU_{name.upper()} {i}u" for name, i in _first_of_each(variables).items()),
        f"#define SW_FMU_VARIABLES {len(variables)}",
        "\n".join(["#define SW_FMU_TABLE { \\", *rows, "}"]),
    ]
    return "\n".join(["/* Generated: the variables of an FMU, and their signals. */", *lines, ""]).encode()


def model_description(variables: Sequence[Variable], token: str, bundle: Bundle, config: Config) -> bytes:
    """Return `modelDescription.xml`. It contains no time, so the same release and vehicle give the same bytes."""
    name, period, add = bundle.manifest.name, repr(config.period_ns / 1e9), ElementTree.SubElement
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=f"ECU with {name}",
        instantiationToken=token,
        description=f"Flow controller: the whole ECU in C with the release {name}, bundle {bundle.digest}",
        version=f"{bundle.short_hash:08x}",
        generationTool="stillwake",
        variableNamingConvention="structured",
    )
    can = dict.fromkeys(
        ("canGetAndSetFMUState", "canSerializeFMUState", "canHandleVariableCommunicationStepSize"), "true"
    )
    add(root, "CoSimulation", can, modelIdentifier=IDENTIFIER, fixedInternalStepSize=period)
    units = add(root, "UnitDefinitions")
    for unit, exponents in _UNITS.items():
        add(add(units, "Unit", name=unit), "BaseUnit", dict(exponents))
    types = add(root, "TypeDefinitions")
    for title, values in ENUMERATIONS.items():
        kind = add(types, "EnumerationType", name=title)
        for value in values:
            add(kind, "Item", name=value.name, value=str(value.value))
    why = "Calls that were refused, and why"
    add(add(root, "LogCategories"), "Category", name="logStatusError", description=why)
    add(root, "DefaultExperiment", startTime="0.0", stepSize=period)
    listed, structure = add(root, "ModelVariables"), add(root, "ModelStructure")
    outputs = []
    for reference, item in enumerate(variables):
        facts = {"name": item.name, "valueReference": str(reference), "description": item.description}
        is_continuous = item.type == "Float64" and item.causality != "output"
        facts |= {"causality": item.causality, "variability": "continuous" if is_continuous else "discrete"}
        if item.unit:
            facts["declaredType" if item.type == "Enumeration" else "unit"] = item.unit
        if item.start:
            facts["start"] = str(item.start != "0").lower() if item.type == "Boolean" else item.start
        if item.causality == "output":
            facts["initial"] = "calculated"
            outputs.append(facts["valueReference"])
        add(listed, item.type, facts)
    for title, more in (("Output", {}), ("InitialUnknown", {"dependencies": ""})):
        for reference_text in outputs:
            add(structure, title, more, valueReference=reference_text)
    return xml_bytes(root)


def xml_bytes(root: ElementTree.Element) -> bytes:
    """Return a document as indented XML with its declaration."""
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def _first_of_each(variables: Sequence[Variable]) -> dict[str, int]:
    """Return each input's value reference by name; for inputs of all sensors, the first one's by the common name."""
    numbered = reversed([*enumerate(variables)])
    return {item.name.partition(".")[0]: i for i, item in numbered if item.causality == "input"}


def _signals(messages: MessageSet) -> dict[str, dict[str, tuple[int, int, int]]]:
    """Return (first bit, number of bits, whether signed) of signals by message of the set and name in the DBC."""
    blocks, found = dbc_bytes().decode("utf-8").split("\nBO_ "), {}
    for message, spec in zip(("pressure", "speed", "command", "status"), messages.specs, strict=True):
        block = next(item for item in blocks if item.startswith(f"{spec.frame_id} {spec.name}:"))
        found[message] = {
            name: (int(start), int(bits), int(sign == "-")) for name, start, bits, sign in _SIGNAL.findall(block)
        }
    return found
