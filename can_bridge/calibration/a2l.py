"""The A2L file (ASAM MCD-2 MC 1.7.1): names, places, limits and units of the calibration, for a measurement tool.

It belongs to one release on one vehicle, whose limits it states.
"""

from typing import Final

from can_bridge.calibration.a2l_interface import META_LANGUAGE, module_interface, segment_interface
from can_bridge.calibration.segment import ADDRESS, DELAY_STEPS, VALUE_BYTES, Segment
from contract.controller.calibration import NAMES, PACKED_BYTES, WEIGHTS

_FLOW_UNIT: Final = "U_inf W"
_DESCRIPTIONS: Final = {
    "drag_mean": "Weight of the mean drag over the horizon",
    "drag_fluctuation": "Weight of the drag's fluctuation over the horizon",
    "lift": "Weight of the mean square of the lift over the horizon",
    "lift_mean": "Weight of the square of the mean lift over the horizon",
    "smoothness": "Weight of the squared steps between planned actions",
    "prior": "Weight of the squared distance from the plan that the optimiser starts from",
    "effort": "Weight of the squared actions",
    "rate": "Weight of the squared step from the action in force to the first planned one",
    "action_limit": "Largest jet flow rate in either direction",
    "command_step": "Largest change of the jet flow rate in a control period",
    "delay_steps": "Actuator delay that is compensated",
}
_UNITS: Final = {"action_limit": _FLOW_UNIT, "command_step": _FLOW_UNIT, DELAY_STEPS: "control periods"}
_CONVERSIONS: Final = {
    "": ("weight", "%10.4", "Without unit"),
    _FLOW_UNIT: ("jet_flow", "%9.5", "Jet flow rate over free stream times width of the truck"),
    "control periods": ("periods", "%3.0", "Whole control periods"),
}
"""Name, format and description of the conversion to each unit. The values in memory are the physical ones."""


def a2l_text(
    segment: Segment,
    *,
    release: str,
    nominal_bitrate: int = 500_000,
    data_bitrate: int | None = 2_000_000,
) -> str:
    """The file's contents.

    Args:
        nominal_bitrate: of the bus, bit/s.
        data_bitrate: of CAN FD frames, bit/s; None for classic CAN.
    """
    module = [
        "/begin A2ML",
        *_indented(META_LANGUAGE.splitlines()),
        "/end A2ML",
        "/begin MOD_PAR " + _text(f"Calibration of release {release}"),
        "  VERSION " + _text(release),
        '  /begin MEMORY_SEGMENT calibration "What may be changed of a release on the vehicle"',
        f"    DATA RAM INTERN {ADDRESS:#010x} {PACKED_BYTES:#x} -1 -1 -1 -1 -1",
        *_indented(segment_interface(), 2),
        "  /end MEMORY_SEGMENT",
        "/end MOD_PAR",
        '/begin MOD_COMMON "Little-endian, IEEE 754"',
        "  BYTE_ORDER MSB_LAST",
        "  ALIGNMENT_LONG 4",
        "  ALIGNMENT_FLOAT32_IEEE 4",
        "/end MOD_COMMON",
        *module_interface(nominal_bitrate=nominal_bitrate, data_bitrate=data_bitrate),
        *_characteristics(segment),
        *_conversions(),
        *_record_layout("FLOAT32", "FLOAT32_IEEE"),
        *_record_layout("UINT32", "ULONG"),
        *_group("weights", "Weights of the cost", WEIGHTS),
        *_group("actuation", "How far and how fast the jets may go", NAMES[len(WEIGHTS) :]),
    ]
    lines = [
        "ASAP2_VERSION 1 71",
        '/begin PROJECT stillwake "A learned flow controller for truck wakes"',
        "  /begin MODULE stillwake " + _text(f"ECU with release {release}"),
        *_indented(module, 2),
        "  /end MODULE",
        "/end PROJECT",
    ]
    return "\n".join(lines) + "\n"


def _characteristics(segment: Segment) -> list[str]:
    lines = list[str]()
    rows = zip(NAMES, segment.limits.least.values, segment.limits.greatest.values, strict=True)
    for index, (name, least, greatest) in enumerate(rows):
        layout = "UINT32" if name == DELAY_STEPS else "FLOAT32"
        conversion, *_ = _CONVERSIONS[_UNITS.get(name, "")]
        lines += [
            f"/begin CHARACTERISTIC {name} {_text(_DESCRIPTIONS[name])}",
            f"  VALUE {ADDRESS + VALUE_BYTES * index:#010x} {layout} 0 {conversion} {least:.9g} {greatest:.9g}",
            "/end CHARACTERISTIC",
        ]
    return lines


def _conversions() -> list[str]:
    lines = list[str]()
    for unit, (name, shape, description) in _CONVERSIONS.items():
        lines += [
            f"/begin COMPU_METHOD {name} {_text(description)}",
            f"  IDENTICAL {_text(shape)} {_text(unit)}",
            "/end COMPU_METHOD",
        ]
    return lines


def _record_layout(name: str, kind: str) -> list[str]:
    return [f"/begin RECORD_LAYOUT {name}", f"  FNC_VALUES 1 {kind} ROW_DIR DIRECT", "/end RECORD_LAYOUT"]


def _group(name: str, description: str, members: tuple[str, ...]) -> list[str]:
    return [
        f"/begin GROUP {name} {_text(description)}",
        "  ROOT",
        f"  /begin REF_CHARACTERISTIC {' '.join(members)} /end REF_CHARACTERISTIC",
        "/end GROUP",
    ]


def _text(words: str) -> str:
    """A string of the format; what is not printable ASCII becomes a question mark."""
    plain = "".join(letter if " " <= letter <= "~" else "?" for letter in words)
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _indented(lines: list[str], times: int = 1) -> list[str]:
    return ["  " * times + line for line in lines]
