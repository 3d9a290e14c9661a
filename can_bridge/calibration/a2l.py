"""The A2L file (ASAM MCD-2 MC 1.7.1): names, places, limits and units of the calibration, for a measurement tool.

It belongs to one release on one vehicle, whose limits it states. What all have in common is in `stillwake.a2l`; its
meta language is what ASAM publishes with XCP (part 2, section "ASAM MCD-2 MC description file", and part 3), as far as
this ECU has it. T1 to T7 are long against a control period, in which every command is answered.
"""

from importlib.resources import files
from string import Template
from typing import Final

from can_bridge.calibration.segment import Segment
from contract.config.vehicle import BusConfig
from contract.controller.calibration import CALIBRATION_NAMES

_CAN_FD: Final = """
        /begin CAN_FD
          MAX_DLC 8
          CAN_FD_DATA_TRANSFER_BAUDRATE {}
        /end CAN_FD"""


_EXTENDED: Final = 1 << 31
"""Marks an identifier of 29 bits (part 3)."""


def a2l_text(segment: Segment, *, release: str, bus: BusConfig) -> str:
    """The file's contents, for an ECU on this bus."""
    ids = {"master": bus.diagnosis.xcp_command, "slave": bus.diagnosis.xcp_response}
    limits = zip(CALIBRATION_NAMES, segment.limits.least.values, segment.limits.greatest.values, strict=True)
    return Template(files(__package__).joinpath("stillwake.a2l").read_text(encoding="ascii")).substitute(
        {name: f"{least:.9g} {greatest:.9g}" for name, least, greatest in limits},
        module=_text(f"ECU with release {release}"),
        parameters=_text(f"Calibration of release {release}"),
        release=_text(release),
        nominal_bitrate=bus.nominal_bitrate,
        can_fd="" if bus.frames == "classic" else _CAN_FD.format(bus.data_bitrate),
        **{name: f"{used.number | used.is_extended * _EXTENDED:#x}" for name, used in ids.items()},
    )


def _text(words: str) -> str:
    """A string of the format; what is not printable ASCII becomes a question mark."""
    plain = "".join(letter if " " <= letter <= "~" else "?" for letter in words)
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'
