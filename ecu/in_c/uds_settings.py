"""The generator of `sw_uds_settings.h`, which gives the UDS server in C the constants of the server in Python."""

from collections.abc import Mapping
from enum import IntEnum
from struct import calcsize
from typing import Any, Final

from can_bridge.calibration import daq, xcp, xcp_slave
from can_bridge.calibration.segment import ADDRESS
from can_bridge.flashing.state import Level
from can_bridge.isotp import endpoint
from can_bridge.uds import fault_memory, security, server, services
from can_bridge.uds.services import Did, Nrc, Routine, Service, Session
from contract.config.vehicle import BusConfig
from contract.controller.c_folder import generated_header
from contract.release.checks import dbc_sha256
from ecu.flashable.links import MOST_FRAMES, XCP_PLACES, isotp_settings
from ecu.flashable.watched_control import REMEMBERED_NS

UDS_SETTINGS: Final = "sw_uds_settings.h"
_ISOTP: Final = isotp_settings(BusConfig())
_NUMBERED: Final[Mapping[str, type[IntEnum]]] = {
    "SERVICE": Service, "SESSION": Session, "NRC": Nrc, "ROUTINE": Routine, "DID": Did, "LEVEL": Level,
    "REPORT": fault_memory.FaultReport,
}  # fmt: skip


def uds_settings() -> bytes:
    """Return the header, which is the same for every release and vehicle."""
    numbers = {
        "MAX_REQUEST": services.MAX_REQUEST,
        "MAX_BLOCK": services.MAX_BLOCK,
        "MAX_DIDS": server.MAX_DIDS,
        "P2_MS": services.P2_MS,
        "P2_EXTENDED_MS": services.P2_EXTENDED_MS,
        "S3_MS": services.S3_MS,
        "LEVELS": len(Level),
        "ACCESS_ATTEMPTS": security.MAX_ATTEMPTS,
        "LONGEST_ANSWER": services.LONGEST_ANSWER,
        # There is space for the longest answer, the other answers that may be queued at the same time, and a refusal in
        # each remaining place of the queue.
        "ISOTP_ROOM": services.LONGEST_ANSWER + services.BESIDE + 3 * _ISOTP.queue,
        "ISOTP_BESIDE": services.BESIDE,
        "ISOTP_QUEUE": _ISOTP.queue,
        "ISOTP_KEPT": endpoint.KEPT_PLACES,
        "ISOTP_WAITS": _ISOTP.max_waits,
        "MOST_FRAMES": MOST_FRAMES,
        "FAULT_COUNT": len(fault_memory.CODES),
        "FAULTS_AVAILABLE": fault_memory.AVAILABLE,
        "FAULTS_FORMAT": fault_memory.J2012_FORMAT,
        "AGED_CYCLES": fault_memory.AGED_CYCLES,
        "SNAPSHOT_BYTES": fault_memory.SNAPSHOT_BYTES,
        **_of_xcp(),
        **{f"{kind}_{item.name}": item.value for kind, items in _NUMBERED.items() for item in items},
    }
    commands = (f"{{{one:#x}u, {one.shortest}u, {int(one in xcp.PROTECTED)}u}}" for one in xcp.Command)
    texts = {
        "ISOTP_BURST": _ISOTP.burst,
        "ISOTP_WAIT_NS": f"INT64_C({_ISOTP.wait_ns})",
        "ACCESS_DELAY_NS": f"INT64_C({security.DELAY_NS})",
        "REMEMBERED_NS": f"INT64_C({REMEMBERED_NS})",
        "FAULT_CODES": _pairs(fault_memory.CODES),
        "SNAPSHOT_PARTS": _pairs({one: calcsize(form) for one, form in fault_memory.SNAPSHOT_FORMATS.items()}),
        # Each row has the number, the least length in bytes, and whether a key is needed.
        "XCP_COMMANDS": "{" + ", ".join(commands) + "}",
        "XCP_IDLE_NS": f"INT64_C({xcp_slave.IDLE_NS})",
        "XCP_A2L_NAME": f'"{xcp_slave.A2L_NAME.decode()}"',
        "XCP_EVENT_NAME": f'"{daq.EVENT_NAME.decode()}"',
        "DBC_SHA256_BYTES": "{" + ", ".join(map(str, bytes.fromhex(dbc_sha256()))) + "}",
    }
    found = {name: f"{value:#x}u" for name, value in numbers.items()} | texts
    return generated_header(UDS_SETTINGS, "the numbers of diagnosis", {f"SW_{name}": found[name] for name in found})


def _of_xcp() -> dict[str, int]:
    named = (
        *("RESOURCES", "CAL_PAG", "COMM_MODE", "MAX_CTO", "PROTOCOL_VERSION", "TRANSPORT_VERSION", "DRIVER_VERSION"),
        *("RESPONSE", "EVENT", "ERROR", "STORED_EVENT", "STORE_REQUEST", "DAQ_RUNNING", "CRC_32"),
        *("ECU_MODE", "XCP_MODE", "ALL_MODE"),
    )
    numbers: dict[str, int] = {name: getattr(xcp, name) for name in named}
    numbers |= {item.name: item.value for item in xcp.Command}
    numbers |= {f"ERROR_{item.name}": item.value for item in xcp.Error}
    numbers |= {
        # A command without an error has this number instead of the number of an error.
        "DONE": 0xFF,
        "SEED_LENGTH": xcp.XCP_SEED_LENGTH,
        "CONNECT_BYTES": xcp.Command.CONNECT.shortest,
        "WORKING_PROPERTIES": xcp_slave.WORKING_PROPERTIES,
        "REFERENCE_PROPERTIES": xcp_slave.REFERENCE_PROPERTIES,
        "ADDRESS": ADDRESS,
        "MEASURED": daq.MEASURED_ADDRESS,
        "PLACES": XCP_PLACES,
        "ODTS": daq.MOST_ODTS,
        "ENTRIES": daq.MOST_ENTRIES,
        "DAQ_PROPERTIES": daq.DYNAMIC,
        "EVENT_PROPERTIES": daq.OF_DAQ,
    }
    return {f"XCP_{name}": number for name, number in numbers.items()}


def _pairs(numbers: Mapping[Any, int]) -> str:
    return "{" + ", ".join(f"{{{int(one)}u, {other}u}}" for one, other in numbers.items()) + "}"
