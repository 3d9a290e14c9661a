"""The description files in an FMU: `modelDescription.xml` (FMI 3.0 and 2.0), the bus terminal, the bus manifest."""

from collections.abc import Mapping, Sequence
from typing import Final
from xml.etree import ElementTree

from contract.config.tree import Config
from contract.release.checks import Bundle
from firmware_sim.fmu.ecu_variables import CONTINUOUS, ENUMERATIONS, IDENTIFIER, SI_UNITS, Variable
from firmware_sim.fmu.kinds import FmuKind

TERMINAL: Final = "CanChannel"
"""Name of the bus terminal in the FMU."""
LS_BUS: Final = "org.fmi-standard.fmi-ls-bus"
_MIME: Final = f'application/{LS_BUS}.can; version="1.0.0"'
_RX_BYTES, _TX_BYTES = 8192, 16384  # sizes in bytes of the buffers; `ecu/c/fmu/sw_fmu.h` must have the same sizes
_TYPES_2: Final[Mapping[str, str]] = {"Float64": "Real", "UInt32": "Integer"}
_add = ElementTree.SubElement


def model_description(
    variables: Sequence[Variable], token: str, bundle: Bundle, config: Config, kind: FmuKind
) -> ElementTree.Element:
    """Return `modelDescription.xml` in FMI 3.0. It has no date, so equal releases and vehicles give equal bytes."""
    name, period = bundle.manifest.name, repr(config.period_ns / 1e9)
    about = f"Flow controller: the whole ECU in C with the release {name}, bundle {bundle.digest}"
    facts = {"fmiVersion": "3.0", "modelName": f"ECU with {name}", "instantiationToken": token, "description": about}
    facts |= {"version": f"{bundle.short_hash:08x}", "generationTool": "stillwake"}
    root = ElementTree.Element("fmiModelDescription", facts, variableNamingConvention="structured")
    can = ["canGetAndSetFMUState", "canSerializeFMUState", "canHandleVariableCommunicationStepSize"]
    can += ["hasEventMode"] if kind.bus else []
    _add(root, "CoSimulation", dict.fromkeys(can, "true"), modelIdentifier=IDENTIFIER, fixedInternalStepSize=period)
    units = _add(root, "UnitDefinitions")
    for unit, exponents in SI_UNITS.items():
        _add(_add(units, "Unit", name=unit), "BaseUnit", dict(exponents))
    types = _add(root, "TypeDefinitions")
    for title, values in ENUMERATIONS.items():
        listed_values = _add(types, "EnumerationType", name=title)
        for value in values:
            _add(listed_values, "Item", name=value.name, value=str(value.value))
    _add(_add(root, "LogCategories"), "Category", name="logStatusError", description="Calls that were refused, and why")
    _add(root, "DefaultExperiment", startTime="0.0", stepSize=period)
    listed, structure = _add(root, "ModelVariables"), _add(root, "ModelStructure")
    outputs = []
    for reference, item in enumerate(variables):
        facts = {"name": item.name, "valueReference": str(reference), "description": item.description}
        is_continuous = item.type == CONTINUOUS and item.causality != "output"
        facts |= {"causality": item.causality, "variability": "continuous" if is_continuous else "discrete"}
        if item.causality == "parameter":
            facts["variability"] = "fixed"
        if item.unit:
            facts["declaredType" if item.type == "Enumeration" else "unit"] = item.unit
        if item.start:
            facts["start"] = str(item.start != "0").lower() if item.type == "Boolean" else item.start
        if item.causality == "output":
            facts["initial"] = "calculated"
            outputs.append(facts["valueReference"])
        _add(listed, item.type, facts)
    if kind.bus:
        references = _list_terminal(listed, len(variables), kind)
        _add(structure, "Output", valueReference=references["Tx_Data"], dependencies=references["Tx_Clock"])
        if kind.triggered:
            _add(structure, "Output", valueReference=references["Tx_Clock"])
    for title, more in (("Output", {}), ("InitialUnknown", {"dependencies": ""})):
        for reference_text in outputs:
            _add(structure, title, more, valueReference=reference_text)
    return root


def _list_terminal(listed: ElementTree.Element, first: int, kind: FmuKind) -> dict[str, str]:
    """Add the terminal's clocks and binary variables to the list. Return their value references, `first` and higher."""
    names = ("Rx_Clock", "Rx_Data", "Tx_Clock", "Tx_Data")  # same order as in ecu/c/fmu/bus/sw_fmu_events.c
    references = {name: str(first + i) for i, name in enumerate(names)}

    def added(tag: str, name: str, causality: str, **more: str) -> ElementTree.Element:
        facts = {"name": f"{TERMINAL}.{name}", "valueReference": references[name], "causality": causality}
        return _add(listed, tag, {**facts, "variability": "discrete", **more})

    added("Clock", "Rx_Clock", "input", intervalVariability="triggered")
    data = {"mimeType": _MIME, "clocks": references["Rx_Clock"], "maxSize": str(_RX_BYTES)}
    _add(added("Binary", "Rx_Data", "input", **data), "Start", value="")
    if kind.triggered:
        added("Clock", "Tx_Clock", "output", intervalVariability="triggered")
    else:
        added("Clock", "Tx_Clock", "input", intervalVariability="countdown", supportsFraction="true")
    data |= {"clocks": references["Tx_Clock"], "maxSize": str(_TX_BYTES), "initial": "calculated"}
    added("Binary", "Tx_Data", "output", **data)
    return references


def bus_files() -> dict[str, bytes]:
    """Return the description files that an FMU with a bus terminal needs in addition, by their paths in the FMU."""
    root = ElementTree.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    facts = {"terminalKind": "org.fmi-ls-bus.network-terminal", "matchingRule": "org.fmi-ls-bus.transceiver"}
    terminal = _add(_add(root, "Terminals"), "Terminal", facts, name=TERMINAL, description="The vehicle's CAN bus")
    for name in ("Rx_Clock", "Rx_Data", "Tx_Clock", "Tx_Data"):
        member = {"variableName": f"{TERMINAL}.{name}", "memberName": name}
        _add(terminal, "TerminalMemberVariable", member, variableKind="signal")
    facts = {"terminalKind": "org.fmi-ls-bus.network-terminal.configuration", "matchingRule": "bus"}
    configuration = _add(terminal, "Terminal", facts, name="Configuration")
    member = {"variableName": "bus_notifications", "memberName": "BusNotifications"}
    _add(configuration, "TerminalMemberVariable", member, variableKind="signal")
    own = "{http://fmi-standard.org/fmi-ls-manifest}fmi-ls-"
    ElementTree.register_namespace("fmi-ls", own[1 : own.index("}")])
    about = (
        "Layered Standard for the simulation of bus communication on a Physical Signal Abstraction or Network "
        "Abstraction based level."
    )
    manifest = ElementTree.Element("fmiLayeredStandardManifest", isBusSimulationFMU="false")
    for name, text in (("name", LS_BUS), ("version", "1.0.0"), ("description", about)):
        manifest.set(own + name, text)
    return {
        "terminalsAndIcons/terminalsAndIcons.xml": xml_bytes(root),
        f"extra/{LS_BUS}/fmi-ls-manifest.xml": xml_bytes(manifest),
    }


def as_fmi2(about: ElementTree.Element, sources: Sequence[str] = ()) -> ElementTree.Element:
    """Convert a description from FMI 3.0 to FMI 2.0; `sources` are the names of the FMU's C files."""
    facts = {name: value for name, value in about.attrib.items() if name not in ("fmiVersion", "instantiationToken")}
    root = ElementTree.Element("fmiModelDescription", facts, fmiVersion="2.0", guid=about.get("instantiationToken", ""))
    kind = _copied(root, about, "CoSimulation")
    for old in ("canGetAndSetFMUState", "canSerializeFMUState"):
        kind.set(old.replace("State", "state"), kind.attrib.pop(old, "false"))
    kind.attrib.pop("fixedInternalStepSize", None)
    listed = _add(kind, "SourceFiles") if sources else kind
    for name in sources:
        _add(listed, "File", name=name)
    _copied(root, about, "UnitDefinitions")
    if enumerations := about.findall("TypeDefinitions/EnumerationType"):
        types = _add(root, "TypeDefinitions")
        for item in enumerations:
            _add(_add(types, "SimpleType", name=item.get("name", "")), "Enumeration").extend(item)
    for title in ("LogCategories", "DefaultExperiment"):
        if about.find(title) is not None:
            _copied(root, about, title)
    variables, places = _add(root, "ModelVariables"), dict[str, str]()
    for place, item in enumerate(about.findall("ModelVariables/*"), start=1):
        places[item.get("valueReference", "")] = str(place)
        own = {name: value for name, value in item.attrib.items() if name in ("start", "unit", "declaredType")}
        facts = {name: value for name, value in item.attrib.items() if name not in own}
        _add(_add(variables, "ScalarVariable", facts), _TYPES_2.get(item.tag, item.tag), own)
    structure = _add(root, "ModelStructure")
    for title, old in (("Outputs", "Output"), ("InitialUnknowns", "InitialUnknown")):
        if unknowns := [places[item.get("valueReference", "")] for item in about.findall(f"ModelStructure/{old}")]:
            section = _add(structure, title)
            for index in unknowns:
                _add(section, "Unknown", {"dependencies": ""} if old == "InitialUnknown" else {}, index=index)
    return root


def _copied(root: ElementTree.Element, about: ElementTree.Element, title: str) -> ElementTree.Element:
    """Copy a section of `about` into `root`; add an empty section if `about` does not have it."""
    found = about.find(title)
    copy = _add(root, title, {} if found is None else dict(found.attrib))
    copy.extend([] if found is None else found)
    return copy


def xml_bytes(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"
