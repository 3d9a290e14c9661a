"""The lists of `docs/reference/diagnosis.md`, from the numbers and permissions of UDS and XCP.

This module has a text that explains each number. A number without a text is an error.
"""

import struct
from collections.abc import Iterable, Mapping
from typing import Final

from can_bridge.calibration import xcp
from can_bridge.calibration.daq import MEASURED_ADDRESS, MEASURED_BYTES
from can_bridge.calibration.segment import ADDRESS
from can_bridge.calibration.xcp_slave import IDLE_NS
from can_bridge.flashing.state import Level
from can_bridge.flashing.verdicts import Verdict
from can_bridge.isotp.endpoint import KEPT_PLACES
from can_bridge.uds import services
from can_bridge.uds.fault_memory import AGED_CYCLES, AVAILABLE, CODES, SNAPSHOT_FORMATS, Snapshot, Status, in_letters
from can_bridge.uds.security import ANSWER_LENGTH, DELAY_NS, LABEL, MAX_ATTEMPTS, SEED_LENGTH
from can_bridge.uds.server import MAX_DIDS
from can_bridge.uds.services import (
    LEVELS,
    ROUTINES,
    SERVICES,
    WRITABLE,
    Did,
    Nrc,
    Permission,
    Routine,
    Service,
    Session,
)
from contract.config.diagnosis import DiagnosisConfig
from contract.config.vehicle import BusConfig
from contract.controller.calibration import PACKED_BYTES
from ecu.flashable.links import XCP_PLACES, isotp_settings
from firmware_sim.runs.reasons import BECAUSE

SERVICE_NAMES: Final[Mapping[Service, str]] = {
    Service.SESSION: "DiagnosticSessionControl",
    Service.RESET: "ECUReset",
    Service.CLEAR_FAULTS: "ClearDiagnosticInformation",
    Service.REPORT_FAULTS: "ReadDTCInformation",
    Service.READ: "ReadDataByIdentifier",
    Service.SECURITY: "SecurityAccess",
    Service.COMMUNICATION: "CommunicationControl",
    Service.WRITE: "WriteDataByIdentifier",
    Service.ROUTINE: "RoutineControl",
    Service.DOWNLOAD: "RequestDownload",
    Service.TRANSFER: "TransferData",
    Service.EXIT: "RequestTransferExit",
    Service.TESTER_PRESENT: "TesterPresent",
    Service.FAULT_SETTING: "ControlDTCSetting",
}
"""Names of the services in ISO 14229-1."""
SERVICE_TEXTS: Final[Mapping[Service, str]] = {
    Service.SESSION: "change the session; `02` needs shut jets, and no request for control",
    Service.RESET: "`01`: boot again, under the conditions of session `02`. Once an image is announced, a reset is "
    "always allowed, and the end of the session also resets the ECU",
    Service.CLEAR_FAULTS: "clear a code of [faults](#faults) (3 bytes), or `FF FF FF` for all, while no jet can run",
    Service.REPORT_FAULTS: "`01`: number of the codes with one of the status bits in the request (1 byte); `02`: these "
    "codes; `04`, code (3 bytes), record (`01` or `FF`): the code's snapshot; `06`, likewise: the age; `0A`: all codes",
    Service.READ: f"read up to {MAX_DIDS} identifiers; the answer leaves out unknown identifiers",
    Service.SECURITY: "request a level's seed; answer the seed",
    Service.COMMUNICATION: "`01`, kind `01` or `03`: stop sending JetCommand and EcuStatus, under the conditions of a "
    "reset and only while no jet can run; `00` or the default session: send them again",
    Service.WRITE: "write an identifier",
    Service.ROUTINE: "`01`: start a routine; no request stops it or asks for its results",
    Service.DOWNLOAD: "`00 44`, then offset and length of the image's missing bytes, 4 bytes each",
    Service.TRANSFER: f"a block of up to {services.MAX_BLOCK} bytes, 2 of them header; the last block may be repeated",
    Service.EXIT: "end the transfer after all bytes have arrived",
    Service.TESTER_PRESENT: "keep the session; `00` asks for an answer, `80` for none",
    Service.FAULT_SETTING: "`02`: stop storing faults; `01` or the default session: store them again",
}
DID_TEXTS: Final[Mapping[Did, str]] = {
    Did.ACTIVE_SESSION: "number of the session, 1 byte",
    Did.SERIAL_NUMBER: "serial number of the ECU, UTF-8",
    Did.HARDWARE: "name of the hardware, UTF-8",
    Did.SOFTWARE_VERSION: "version of stillwake, UTF-8",
    Did.DBC_SHA256: "SHA-256 of `contract/stillwake.dbc`, 32 bytes",
    Did.STORE: "slots, running release, reason of the boot; 116 bytes and both names (`can_bridge/flashing/report.py`)",
    Did.KEY_LIST: "read: version of the key list, 4 bytes, 0 for none; write: a signed key list",
    Did.CAPACITY: "size of the largest image that the ECU can store, 4 bytes",
    Did.PERIOD_NS: "control period in ns, 8 bytes",
    Did.CALIBRATION: "read: the calibration in force; write: the calibration from the next control period on",
    Did.CALIBRATION_LIMITS: f"the smallest, the largest and the release's own values, {3 * PACKED_BYTES} bytes",
    Did.CALIBRATION_STORED: "read: 1 if values are stored; write: 1 stores the values, 0 restores the release's values",
}
ROUTINE_TEXTS: Final[Mapping[Routine, str]] = {
    Routine.PRECONDITIONS: "check whether the ECU may be programmed now",
    Routine.SELF_TEST: "run control steps of the running release",
    Routine.ACTIVATE: "boot the checked image from the next reset on, on trial",
    Routine.CONFIRM: "confirm the release on trial, after its self-test in this boot and before an announcement",
    Routine.REVERT: "boot the previous release from the next reset on",
    Routine.ERASE: "announce an image: length (4 bytes) and SHA-256 (32); the answer is the offset to begin at (4)",
    Routine.CHECK: "check the image; the answer is a [verdict](#verdicts) (1 byte)",
}
NRC_TEXTS: Final[Mapping[Nrc, str]] = {
    Nrc.SERVICE_NOT_SUPPORTED: "",
    Nrc.SUB_FUNCTION_NOT_SUPPORTED: "there is no such session, reset, level, report, setting or routine control",
    Nrc.INCORRECT_LENGTH: "the request is too short or too long",
    Nrc.RESPONSE_TOO_LONG: f"more than {services.LONGEST_ANSWER} bytes of identifiers in one answer: ask for fewer",
    Nrc.BUSY_REPEAT_REQUEST: "another request is in progress, or answers wait to be sent",
    Nrc.CONDITIONS_NOT_CORRECT: "the jets are enabled or can run, the vehicle asks for control, no release runs, the "
    "previous release is invalid, or another download is in progress",
    Nrc.SEQUENCE_ERROR: "a seed, announcement, download or self-test must come before, or bytes are missing",
    Nrc.OUT_OF_RANGE: "unknown identifier, routine (in this session), code or record; or an invalid value",
    Nrc.SECURITY_ACCESS_DENIED: "the level is locked",
    Nrc.INVALID_KEY: "the answer to the seed is wrong",
    Nrc.EXCEEDED_ATTEMPTS: f"at least {MAX_ATTEMPTS} wrong answers in a row",
    Nrc.DELAY_NOT_EXPIRED: f"a seed was requested within {DELAY_NS / 1e9:g} s after too many wrong answers",
    Nrc.UPLOAD_DOWNLOAD_NOT_ACCEPTED: "",
    Nrc.TRANSFER_SUSPENDED: "a block has more bytes than are missing",
    Nrc.PROGRAMMING_FAILURE: "the memory or the self-test failed",
    Nrc.WRONG_BLOCK_COUNTER: "a block is missing",
    Nrc.RESPONSE_PENDING: "the request, for example an erasure, takes longer; the answer follows",
    Nrc.SUB_FUNCTION_NOT_IN_SESSION: "the level exists, but not in this session",
    Nrc.SERVICE_NOT_IN_SESSION: "",
}
UNSENT: Final = frozenset({Nrc.UPLOAD_DOWNLOAD_NOT_ACCEPTED})
"""Codes that the ECU never sends. Only the tester's code contains these codes."""
SNAPSHOT_TEXTS: Final[Mapping[Snapshot, str]] = {
    Snapshot.TIME_MS: "milliseconds since power-on",
    Snapshot.MODE_BEFORE: "mode of EcuStatus in the previous control period",
    Snapshot.MISSED: "number of control periods without usable pressures since power-on",
    Snapshot.OVERRUNS: "number of skipped control periods since power-on",
    Snapshot.PRESSURES_CP: "newest pressure coefficients before the fault's period, as float32; 0 if there are none",
}
STATUS_TEXTS: Final[Mapping[Status, str]] = {
    Status.TEST_FAILED: "the fault is present; this bit is cleared when control runs",
    Status.FAILED_THIS_CYCLE: "the fault occurred since power-on",
    Status.PENDING: "the fault occurred in this operation cycle, or in the latest cycle with a test",
    Status.CONFIRMED: "the fault occurred, and its code has not been cleared or removed since then",
    Status.NOT_COMPLETED_SINCE_CLEAR: "neither the fault nor control occurred since the last clearing",
    Status.FAILED_SINCE_CLEAR: "the fault occurred since the last clearing",
    Status.NOT_COMPLETED_THIS_CYCLE: "neither the fault nor control occurred since power-on",
}
_IDS: Final = DiagnosisConfig()
_ISOTP: Final = isotp_settings(BusConfig())
STATED: Final = (
    f"within {services.P2_MS} ms",
    f"at least every {services.P2_EXTENDED_MS / 1000:g} s",
    f"at most {services.MAX_REQUEST} bytes",
    f"to this ECU with the identifier {_IDS.request_id},",
    f"answers with {_IDS.response_id}.",
    f"XCP uses {_IDS.xcp_command_id} from",
    f"calibration tool, and {_IDS.xcp_response_id} from the ECU",
    f"refusals {', '.join(f'`{one:02X}`' for one in sorted(services.UNSENT_TO_ALL))} are not sent",
    *(f"`{one:02X}` {one.name.lower()}: " for one in Session),
    f"ends {services.S3_MS / 1000:g} s after",
    f"overdue by {_ISOTP.wait_ns / 1e9:g} s",
    f"more than {services.BESIDE} bytes",
    f"While {_ISOTP.queue - KEPT_PLACES} answers wait, requests",
    f"at most {services.LONGEST_ANSWER} bytes",
    f"seed has {SEED_LENGTH} random bytes.",
    f"the {ANSWER_LENGTH}-byte AES-CMAC",
    f'"{LABEL.decode()}", then the level\'s number, {Level.PROGRAMMING} or {Level.CALIBRATION},',
    f"After {MAX_ATTEMPTS} wrong answers in a row the level gives no seed for {DELAY_NS / 1e9:g} s",
    f"After {AGED_CYCLES} cycles",
    f"mask is `{AVAILABLE:02X}`",
    f"protocol {xcp.PROTOCOL_VERSION}.x",
    f"up to {xcp.MAX_CTO} bytes. One segment of {PACKED_BYTES} bytes, with two pages, is at address 0x{ADDRESS:X}.",
    f"The {MEASURED_BYTES} bytes at address 0x{MEASURED_ADDRESS:X} are",
    f"While {XCP_PLACES} answers wait to be sent",
    f"After {IDLE_NS // 60_000_000_000} minutes without a command",
)
"""Phrases of the page that contain numbers from the code. A test checks that the page has these phrases."""


def parts() -> dict[str, str]:
    """Return the generated parts of the page by their names."""
    lists: dict[str, Iterable[tuple[str, str]]] = {
        "services": (
            (f"{_byte(one)} {SERVICE_NAMES[one]}{_who(SERVICES[one])}", SERVICE_TEXTS[one]) for one in sorted(Service)
        ),
        "levels": ((f"`27 {one:02X}`, `27 {one + 1:02X}`", f"{_words(one.name)}{_who(LEVELS[one])}") for one in Level),
        "identifiers": ((f"{_named(one)}{_who(WRITABLE.get(one))}", DID_TEXTS[one]) for one in sorted(Did)),
        "routines": ((f"{_named(one)}{_who(ROUTINES[one])}", ROUTINE_TEXTS[one]) for one in sorted(Routine)),
        "codes": ((f"{in_letters(CODES[one])}, `{CODES[one]:06X}` {one.name}", BECAUSE[one]) for one in sorted(CODES)),
        "status": ((f"{_byte(one)} {_words(one.name or '')}", STATUS_TEXTS[one]) for one in Status),
        "snapshot": (
            (f"`{one:04X}`, {struct.calcsize(form)} bytes", SNAPSHOT_TEXTS[one])
            for one, form in SNAPSHOT_FORMATS.items()
        ),
        "verdicts": ((f"{one.value} {one.name}", one.in_words) for one in Verdict),
        "refusals": ((f"{_byte(one)} {_words(one.name)}", NRC_TEXTS[one]) for one in Nrc if one not in UNSENT),
    }
    commands = ", ".join(f"{_byte(one)} {one.name}{'*' if one in xcp.PROTECTED else ''}" for one in xcp.Command)
    made = {
        f"uds_{part}": "\n".join(f"- {name}{text and ': '}{text}" for name, text in lines)
        for part, lines in lists.items()
    }
    return made | {"xcp_commands": f"{commands}."}


def _who(permission: Permission | None) -> str:
    """Return the sessions in which a request is allowed, and whether the level must be unlocked."""
    if permission is None or permission.sessions == frozenset(Session):
        return ""
    names = ", ".join(_words(one.name) for one in sorted(permission.sessions))
    return f" ({names}{', unlocked' if permission.level else ''})"


def _named(one: Did | Routine) -> str:
    return f"`{one:04X}` {_words(one.name)}"


def _words(name: str) -> str:
    return name.lower().replace("_", " ")


def _byte(number: int) -> str:
    return f"`{number:02X}`"
