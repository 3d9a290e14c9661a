"""The variables of the ECU's FMU, each with the signal of the DBC that carries it.

A variable's place in the list is its value reference. The same list becomes the table that the C wrapper
(`export/to_c/sources/fmu/sw_fmu.c`) works by, and `modelDescription.xml`.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, Literal
from xml.etree import ElementTree

from can_bridge.wire.message_sets import MessageSet, message_set
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from contract.release.checks import Bundle, dbc_bytes

IDENTIFIER: Final = "stillwake_ecu"
UNITS: Final[Mapping[str, Mapping[str, int]]] = {
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "m/s": {"m": 1, "s": -1},
    "m2/s": {"m": 2, "s": -1},
    "kg/m3": {"kg": 1, "m": -3},
    "s": {"s": 1},
}
"""Exponents of SI base units."""
ENUMERATIONS: Final[Mapping[str, type[IntEnum]]] = {"Mode": Mode, "Reason": Reason}
_KINDS: Final = {"Float64": "FLOAT64", "UInt32": "UINT32", "Boolean": "BOOLEAN", "Enumeration": "INT64"}
_SIGNAL: Final = re.compile(r"^ SG_ (\w+) : (\d+)\|(\d+)@1([+-]) ", re.MULTILINE)


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One variable.

    Attributes:
        message: `pressure`, `speed`, `command` or `status` of a `MessageSet`, empty for what is no signal.
        signal: its name in the DBC.
        type: of FMI 3.0.
        unit: key of `UNITS`, or of `ENUMERATIONS` for that type.
        first: value at the start.
        scale: what a step of the wire is in the unit; inputs are scaled by the wrapper itself.
        macro: by which C knows its value reference.
    """

    name: str
    description: str
    causality: Literal["input", "output", "independent"] = "output"
    message: str = ""
    signal: str = ""
    type: str = "Float64"
    unit: str = ""
    first: float = 0.0
    scale: float = 1.0
    macro: str = ""


def ecu_variables(sensors: Sequence[str], config: Config) -> list[Variable]:
    """All of them, in the order of their value references; `sensors` in the order of the Pressure message."""
    found = [Variable(name="time", description="Time", causality="independent", unit="s")]

    def add(name: str, description: str, message: str = "", signal: str = "", **more: str | float) -> None:
        found.append(Variable(name=name, description=description, message=message, signal=signal, **more))  # type: ignore[arg-type]

    def add_input(name: str, description: str, message: str, signal: str, macro: str, **more: str | float) -> None:
        add(name, description, message, signal, causality="input", macro=macro, **more)

    for i, sensor in enumerate(sensors):
        what = f"Wall pressure at {sensor}, less that of the free stream"
        add_input(f"pressure.{sensor}", what, "pressure", f"Pressure{i}", "" if i else "PRESSURE", unit="Pa")
    for i, sensor in enumerate(sensors):
        what = f"Whether {sensor} finds itself sound"
        macro = "" if i else "VALID"
        add_input(f"valid.{sensor}", what, "pressure", f"Valid{i}", macro, type="Boolean", first=1.0)
    flag = {"type": "Boolean"}
    what = "Whether control is wanted; it has to be seen false before"
    add_input("enable_request", what, "pressure", "EnableRequest", "ENABLE_REQUEST", **flag)
    what = "Age of the pressures when they are sent"
    add_input("pressure_age", what, "pressure", "Age", "PRESSURE_AGE", unit="s")
    what, speed = "Through the air; below 0 where it is not known", config.operating_point.speed
    add_input("vehicle_speed", what, "speed", "Speed", "SPEED", unit="m/s", first=speed)
    add_input("air_density", "0 where it is not known", "speed", "AirDensity", "DENSITY", unit="kg/m3")
    what = "Whether this period's frame with the {} comes"
    add_input("send_pressures", what.format("pressures"), "", "", "SEND_PRESSURES", **flag, first=1.0)
    add_input("send_speed", what.format("speed"), "", "", "SEND_SPEED", **flag, first=1.0)
    resolution = FLOW_RESOLUTION_M2_PER_S
    add("flow_command", "Jet flow rate per unit span to be reached", "command", "Flow", unit="m2/s", scale=resolution)
    what = "Whether the jets are to reach the flow at the end of the next control period, and not of this one"
    add("next_period", what, "command", "NextPeriod", **flag)
    add("enable", "Whether the jets may run", "command", "Enable", **flag)
    add("mode", "What the ECU does", "command", "Mode", type="Enumeration", unit="Mode")
    add("reason", "Why it does not control", "status", "Reason", type="Enumeration", unit="Reason")
    for name, signal, what in (
        ("overruns", "Overruns", "Control periods left out"),
        ("missed", "Missed", "Control periods without usable pressures"),
        ("crc_errors", "CrcErrors", "Pressure frames with a wrong CRC"),
        ("refused", "Refused", "Pressure frames repeated or out of sequence"),
        ("bus_off", "BusOff", "Times that the CAN controller was off the bus"),
    ):
        add(name, what, "status", signal, type="UInt32")
    for i, sensor in enumerate(sensors):
        add(
            f"set_aside.{sensor}", f"Whether the ECU estimates {sensor} by the others", "status", f"SetAside{i}", **flag
        )
    signals = _signals(message_set(config.bus))
    # The classic set says less: inputs without a signal stay, since a pressure itself can be invalid there.
    return [item for item in found if item.causality != "output" or item.signal in signals[item.message]]


def wrapper_settings(variables: Sequence[Variable], token: str, config: Config) -> bytes:
    """`sw_fmu_settings.h`: what the wrapper in C is compiled with.

    Args:
        token: the FMU's instantiation token.
    """
    messages = message_set(config.bus)
    signals = _signals(messages)
    rows = []
    for item in variables:
        start, bits, is_signed = signals.get(item.message, {}).get(item.signal, (0, 0, 0))
        message = item.message.upper() if item.causality == "output" else "NO_MESSAGE"
        is_input = int(item.causality == "input")
        rows.append(
            f"    {{{_KINDS[item.type]}, {is_input}, {item.first!r}, {message}, {start}, {bits}, {is_signed}, "
            f"{item.scale!r}}}, /* {item.name} */"
        )
    age_bits = signals["pressure"]["Age"][1]
    lines = [
        f'#define SW_FMU_TOKEN "{token}"',
        f"#define SW_FMU_PRESSURE_LIMIT {round(messages.pressure_limit_pa / messages.pressure_resolution_pa)}",
        f"#define SW_FMU_AGE_LIMIT {2**age_bits - 1}",
        *(f"#define SW_FMU_{item.macro} {i}u" for i, item in enumerate(variables) if item.macro),
        f"#define SW_FMU_VARIABLES {len(variables)}",
        "#define SW_FMU_TABLE { \\",
        *(f"{row} \\" for row in rows),
        "}",
    ]
    text = "\n".join(lines)
    return (
        "/* Generated: the variables of an FMU, and the signals that carry them. */\n"
        f"#ifndef SW_FMU_SETTINGS_H\n#define SW_FMU_SETTINGS_H\n\n{text}\n\n#endif\n"
    ).encode()


def model_description(variables: Sequence[Variable], token: str, bundle: Bundle, config: Config) -> bytes:
    """`modelDescription.xml`, without a time: the same release and vehicle give the same bytes."""
    name = bundle.manifest.name
    period = repr(config.period_ns / 1e9)
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=f"ECU with {name}",
        instantiationToken=token,
        description=f"Flow controller: the whole ECU in C with the release {name}, bundle {bundle.digest}",
        version=f"{bundle.short_hash:08x}",
        license="MIT",
        generationTool="stillwake",
        variableNamingConvention="structured",
    )
    add = ElementTree.SubElement
    add(
        root,
        "CoSimulation",
        modelIdentifier=IDENTIFIER,
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        canHandleVariableCommunicationStepSize="true",
        fixedInternalStepSize=period,
    )
    units = add(root, "UnitDefinitions")
    for unit, exponents in UNITS.items():
        add(add(units, "Unit", name=unit), "BaseUnit", {base: str(power) for base, power in exponents.items()})
    types = add(root, "TypeDefinitions")
    for title, values in ENUMERATIONS.items():
        kind = add(types, "EnumerationType", name=title)
        for value in values:
            add(kind, "Item", name=value.name, value=str(value.value))
    categories = add(root, "LogCategories")
    add(categories, "Category", name="logStatusError", description="Calls that were refused, and why")
    add(root, "DefaultExperiment", startTime="0.0", stepSize=period)
    listed, structure = add(root, "ModelVariables"), add(root, "ModelStructure")
    for reference, item in enumerate(variables):
        made = add(
            listed,
            item.type,
            name=item.name,
            valueReference=str(reference),
            description=item.description,
            causality=item.causality,
        )
        made.set("variability", "continuous" if item.causality != "output" and item.type == "Float64" else "discrete")
        if item.unit:
            made.set("declaredType" if item.type == "Enumeration" else "unit", item.unit)
        if item.causality == "input":
            made.set("start", str(item.first != 0.0).lower() if item.type == "Boolean" else repr(item.first))
        if item.causality == "output":
            made.set("initial", "calculated")
            add(structure, "Output", valueReference=str(reference))
    for reference, item in enumerate(variables):
        if item.causality == "output":
            add(structure, "InitialUnknown", valueReference=str(reference), dependencies="")
    return xml_bytes(root)


def xml_bytes(root: ElementTree.Element) -> bytes:
    """A document with its declaration, indented."""
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def _signals(messages: MessageSet) -> dict[str, dict[str, tuple[int, int, int]]]:
    """By message of the set and name in the DBC: first bit, bits, whether it is signed."""
    blocks = dbc_bytes().decode("utf-8").split("\nBO_ ")
    found = {}
    for message in ("pressure", "speed", "command", "status"):
        spec = getattr(messages, message).spec
        block = next(item for item in blocks if item.startswith(f"{spec.frame_id} {spec.name}:"))
        found[message] = {
            name: (int(start), int(bits), int(sign == "-")) for name, start, bits, sign in _SIGNAL.findall(block)
        }
    return found
