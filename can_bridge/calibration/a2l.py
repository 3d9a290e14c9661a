"""The A2L file (ASAM MCD-2 MC 1.7.1): names, addresses, limits and units of the calibration, for a measurement tool.

A file belongs to one release on one vehicle, and states the limits that this vehicle sets. `stillwake.a2l` has the text
that all files share. Its A2ML blocks are those of ASAM's XCP standard (part 2, section "ASAM MCD-2 MC description
file", and part 3), reduced to the features of this ECU. The timeouts T1 to T7 are longer than a control period, because
the ECU answers every command within a control period.
"""

from collections.abc import Iterator
from enum import IntEnum
from importlib.resources import files
from string import Template
from typing import Final

from can_bridge.calibration.daq import EVENT_NAME, MEASURED_ADDRESS, cycle_of
from can_bridge.calibration.segment import Segment
from can_bridge.wire.messages import SENSORS, Mode, Reason
from contract.config.vehicle import BusConfig
from contract.controller.calibration import CALIBRATION_NAMES
from contract.controller.interface import TERMS

_CAN_FD: Final = """
        /begin CAN_FD
          MAX_DLC 8
          CAN_FD_DATA_TRANSFER_BAUDRATE {}
        /end CAN_FD"""
_EXTENDED: Final = 1 << 31
"""The bit that marks a 29-bit identifier (XCP, part 3)."""
_MOST_CP: Final = 100
"""Largest magnitude of a pressure coefficient in a tool's display, far above every pressure coefficient that occurs."""


def a2l_text(segment: Segment, *, release: str, bus: BusConfig, period_ns: int) -> str:
    """Return the contents of the A2L file for an ECU on this bus with this control period."""
    ids = {"master": bus.diagnosis.xcp_command, "slave": bus.diagnosis.xcp_response}
    limits = zip(CALIBRATION_NAMES, segment.limits.least.values, segment.limits.greatest.values, strict=True)
    limited = {name: f"{least:.9g} {greatest:.9g}" for name, least, greatest in limits}
    measured = list(_measured(limited))
    return Template(files(__package__).joinpath("stillwake.a2l").read_text(encoding="ascii")).substitute(
        limited,
        module=_text(f"ECU with release {release}"),
        parameters=_text(f"Calibration of release {release}"),
        release=_text(release),
        nominal_bitrate=bus.nominal_bitrate,
        can_fd="" if bus.frames == "classic" else _CAN_FD.format(bus.data_bitrate),
        event=EVENT_NAME.decode(),
        cycle="{} {}".format(*cycle_of(period_ns)),
        measurements="\n".join(_measurements(measured)),
        measured="\n        ".join(name for name, *_ in measured),
        tables="\n".join(table for numbers in (Mode, Reason) for table in _table(numbers)),
        **{name: f"{used.number | used.is_extended * _EXTENDED:#x}" for name, used in ids.items()},
    )


def _measured(limits: dict[str, str]) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield name, description, type, conversion and range of each measured value, in the order of `measured_bytes`."""
    for sensor in range(1, SENSORS + 1):
        yield f"pressure_{sensor}", f"Cp of sensor {sensor}", "FLOAT32_IEEE", "weight", f"-{_MOST_CP} {_MOST_CP}"
    most = limits["action_limit"].split()[1]
    yield "command", "Jet flow rate that was sent", "FLOAT32_IEEE", "jet_flow", f"-{most} {most}"
    yield "mode", "Operating mode", "UBYTE", "mode", "0 255"
    yield "reason", "Why the jets are shut", "UBYTE", "reason", "0 255"
    yield "gated", "What the command gate changed", "UBYTE", "bits", "0 255"
    yield "correction", "Speed in use above the speed on the bus, in thousandths", "SBYTE", "weight", "-127 127"
    units = dict.fromkeys(TERMS, "weight") | {"delay_steps": "periods"}
    for name in CALIBRATION_NAMES:
        kind = "ULONG" if name == "delay_steps" else "FLOAT32_IEEE"
        yield f"{name}_in_force", f"{name} in this period", kind, units.get(name, "jet_flow"), limits[name]


def _measurements(measured: list[tuple[str, str, str, str, str]]) -> Iterator[str]:
    address = MEASURED_ADDRESS
    for name, description, kind, conversion, limits in measured:
        yield (
            f'    /begin MEASUREMENT {name} "{description}"\n      {kind} {conversion} 0 0 {limits}\n'
            f"      ECU_ADDRESS {address:#x}\n    /end MEASUREMENT"
        )
        address += 1 if kind.endswith("BYTE") else 4


def _table(numbers: type[IntEnum]) -> Iterator[str]:
    name = numbers.__name__.lower()
    yield (
        f'    /begin COMPU_METHOD {name} "Words for numbers"\n      TAB_VERB "%3.0" ""\n'
        f"      COMPU_TAB_REF {name}_words\n    /end COMPU_METHOD"
    )
    rows = "".join(f'\n      {item.value} "{item.name}"' for item in numbers)
    yield (
        f'    /begin COMPU_VTAB {name}_words "Words of {name}"\n      TAB_VERB {len(numbers)}{rows}\n'
        "    /end COMPU_VTAB"
    )


def _text(words: str) -> str:
    """Return a string of the A2L format; a question mark replaces each character that is not printable ASCII."""
    plain = "".join(letter if " " <= letter <= "~" else "?" for letter in words)
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'
