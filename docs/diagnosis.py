"""Write `docs/reference/diagnosis.md` from the numbers of UDS, their permissions and those of XCP: `make generated`.

What a number means stands here once for each; one that has no text here is an error.
"""

import struct
import sys
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from can_bridge.calibration import xcp
from can_bridge.calibration.segment import ADDRESS
from can_bridge.calibration.xcp_slave import IDLE_NS
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.verdicts import Verdict
from can_bridge.isotp.endpoint import KEPT
from can_bridge.uds import services
from can_bridge.uds.access_key import ANSWER_LENGTH, LABEL, SEED_LENGTH
from can_bridge.uds.fault_codes import CODES, SNAPSHOT_FORMATS, Snapshot, in_letters
from can_bridge.uds.fault_memory import AGED_CYCLES, AVAILABLE, Status
from can_bridge.uds.permissions import LEVELS, ROUTINES, SERVICES, WRITABLE, Permission
from can_bridge.uds.security import DELAY_NS, MAX_ATTEMPTS
from can_bridge.uds.server import MAX_DIDS
from can_bridge.uds.services import Did, Nrc, Routine, Service, Session
from contract.config.diagnosis import DiagnosisConfig
from contract.config.vehicle import BusConfig
from contract.controller.calibration import PACKED_BYTES
from ecu.flashable.links import isotp_settings
from firmware_sim.runs.reasons import BECAUSE

ROOT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = ROOT / "docs" / "reference" / "diagnosis.md"
_ISOTP: Final = isotp_settings(BusConfig())

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
"""As the standard has them."""
SERVICE_TEXTS: Final[Mapping[Service, str]] = {
    Service.SESSION: "change the session; to `02` only while the jets are shut and the vehicle asks for no control",
    Service.RESET: "`01`: boot again, under the conditions of that session; after an image was announced always, "
    "and by the session's end, too",
    Service.CLEAR_FAULTS: "code (3), or `FF FF FF` for all: forget [faults](#faults), while no jet can run",
    Service.REPORT_FAULTS: "`01` how many codes have one of these status bits (1), `02` which; `04` a code's snapshot, "
    "`06` its age: code (3), record `01` or `FF`; `0A` all codes",
    Service.READ: f"read up to {MAX_DIDS} identifiers; those that are not there are left out of the answer",
    Service.SECURITY: "ask for a level's seed, and answer it",
    Service.COMMUNICATION: "`01`, kind `01` or `03`: send no JetCommand and EcuStatus, under the conditions of a "
    "reset; they are sent all the same while a jet can run; `00`: send them again, as by the default session",
    Service.WRITE: "write an identifier",
    Service.ROUTINE: "`01`: start a routine; there are no others to stop or to ask",
    Service.DOWNLOAD: "`00 44`, offset (4), length (4): the bytes of the image that are missing",
    Service.TRANSFER: f"a block of up to {services.MAX_BLOCK} bytes with these two; the last one may come again",
    Service.EXIT: "all bytes have come",
    Service.TESTER_PRESENT: "`00`, or `80` without an answer: keep the session",
    Service.FAULT_SETTING: "`02`: enter no faults; `01`: enter them again, as by the default session",
}
DID_TEXTS: Final[Mapping[Did, str]] = {
    Did.ACTIVE_SESSION: "number of the session, 1 byte",
    Did.SERIAL_NUMBER: "serial number of the ECU, UTF-8",
    Did.HARDWARE: "name of the hardware, UTF-8",
    Did.SOFTWARE_VERSION: "version of stillwake, UTF-8",
    Did.DBC_SHA256: "SHA-256 of `contract/stillwake.dbc`, 32 bytes",
    Did.STORE: "what the slots hold, what runs and why, 116 bytes and both names (`can_bridge/flashing/report.py`)",
    Did.KEY_LIST: "read: version of the key list, 4 bytes, 0 for none; write: a signed key list",
    Did.CAPACITY: "size of the greatest image, 4 bytes",
    Did.PERIOD_NS: "control period in ns, 8 bytes",
    Did.CALIBRATION: "the calibration in force; written, the one from the next control period on",
    Did.CALIBRATION_LIMITS: f"least, greatest and the release's own calibration, {3 * PACKED_BYTES} bytes",
    Did.CALIBRATION_STORED: "read: 1 if one is stored; write 1: store the one in force; 0: the release's own again",
}
ROUTINE_TEXTS: Final[Mapping[Routine, str]] = {
    Routine.PRECONDITIONS: "may the ECU be programmed now?",
    Routine.SELF_TEST: "run control steps of the release that runs",
    Routine.ACTIVATE: "boot the checked image from the next reset on, on trial",
    Routine.CONFIRM: "keep the release that runs on trial; once it passed its self-test since this boot, and before "
    "another image is announced",
    Routine.REVERT: "boot the release before from the next reset on",
    Routine.ERASE: "announce an image: its length (4), its SHA-256 (32). The answer has the offset from which it is "
    "wanted (4)",
    Routine.CHECK: "check the image. The answer has a [verdict](#verdicts) (1)",
}
NRC_TEXTS: Final[Mapping[Nrc, str]] = {
    Nrc.SERVICE_NOT_SUPPORTED: "no such service here",
    Nrc.SUB_FUNCTION_NOT_SUPPORTED: "no such session, reset, level, report, setting or kind of routine control",
    Nrc.INCORRECT_LENGTH: "the request has the wrong length",
    Nrc.RESPONSE_TOO_LONG: f"the identifiers that were asked for come to more than {services.LONGEST_ANSWER} bytes in "
    "one answer: ask for fewer",
    Nrc.BUSY_REPEAT_REQUEST: "another request is still worked on, or its long answer is not on the bus as a whole",
    Nrc.CONDITIONS_NOT_CORRECT: "the jets are enabled or the vehicle asks for control; or no release runs; or the "
    "release before is not in order; or another download is under way; or faults are to be cleared while a jet can run",
    Nrc.SEQUENCE_ERROR: "not its turn: no seed, announcement, download or self-test before it, or bytes are missing",
    Nrc.OUT_OF_RANGE: "no such identifier or routine in this session, no such code or record; or a value that the ECU "
    "does not take",
    Nrc.SECURITY_ACCESS_DENIED: "the level is locked",
    Nrc.INVALID_KEY: "the answer to the seed is wrong",
    Nrc.EXCEEDED_ATTEMPTS: f"that was the wrong answer number {MAX_ATTEMPTS} in a row, or a later one",
    Nrc.DELAY_NOT_EXPIRED: f"no seed within {DELAY_NS / 1e9:g} s after that",
    Nrc.UPLOAD_DOWNLOAD_NOT_ACCEPTED: "not sent",
    Nrc.TRANSFER_SUSPENDED: "a block has more bytes than are missing",
    Nrc.PROGRAMMING_FAILURE: "the memory failed, or the self-test did",
    Nrc.WRONG_BLOCK_COUNTER: "a block was left out",
    Nrc.RESPONSE_PENDING: "it takes longer, as erasing does; the answer follows",
    Nrc.SUB_FUNCTION_NOT_IN_SESSION: "the level is there, not in this session",
    Nrc.SERVICE_NOT_IN_SESSION: "the service is there, not in this session",
}
SNAPSHOT_TEXTS: Final[Mapping[Snapshot, str]] = {
    Snapshot.TIME_MS: "milliseconds since power-on",
    Snapshot.MODE_BEFORE: "mode of EcuStatus in the control period before",
    Snapshot.MISSED: "control periods without usable pressures since power-on",
    Snapshot.OVERRUNS: "control periods left out since power-on",
    Snapshot.PRESSURES_CP: "the newest pressure coefficients of that period, as float32; 0 without",
}
STATUS_TEXTS: Final[Mapping[Status, str]] = {
    Status.TEST_FAILED: "the fault stands; gone once control runs",
    Status.FAILED_THIS_CYCLE: "it was found since power-on",
    Status.PENDING: "it was found in this operation cycle or in the latest one that tested it",
    Status.CONFIRMED: "it was found, and not cleared or forgotten since",
    Status.NOT_COMPLETED_SINCE_CLEAR: "neither it nor control was there since the last clearing",
    Status.FAILED_SINCE_CLEAR: "it was found since the last clearing",
    Status.NOT_COMPLETED_THIS_CYCLE: "neither it nor control was there since power-on",
}
ID_TEXTS: Final[Mapping[str, str]] = {
    "request_id": "UDS (ISO 14229-1) over ISO-TP (ISO 15765-2), from the tester to this ECU (physical addressing)",
    "response_id": "the ECU's answers",
    "functional_id": "UDS, from the tester to every ECU (functional addressing)",
    "xcp_command_id": "XCP, from the calibration tool",
    "xcp_response_id": "XCP, from the ECU",
}
UNSENT: Final = frozenset({Nrc.UPLOAD_DOWNLOAD_NOT_ACCEPTED})
"""Codes that no answer has; they are known to the tester alone."""
SESSION_TEXTS: Final[Mapping[Session, str]] = {
    Session.DEFAULT: "read",
    Session.PROGRAMMING: "flash; while the jets are shut",
    Session.EXTENDED: "calibrate; also while control runs",
}


def page() -> str:
    """The whole page."""
    return (
        "\n\n".join(
            (
                _head(),
                "## Sessions",
                _table(
                    ("number", "session", "for"),
                    ((_byte(one), _words(one.name), SESSION_TEXTS[one]) for one in Session),
                ),
                _wrapped(f"""A session other than the default one ends {services.S3_MS / 1000:g} s after the last
answer. The time rests while a request arrives, is worked on or is answered, however
slowly its frames follow each other on the bus; a request whose next frame is overdue by
{_ISOTP.n_cr_ns / 1e9:g} s counts as none."""),
                _wrapped(f"""The ECU works on one request at a time. Another one that comes before the
answer is ready, or before one of more than {services.BESIDE} bytes is on the bus as a
whole, is refused with `21` and not carried out; of a flood, what comes behind
{_ISOTP.queue - KEPT} answers that wait is lost. An answer with several identifiers has at
most {services.LONGEST_ANSWER} bytes, which is what the ECU in C has room for."""),
                "## Services",
                _table(
                    ("number", "service", "does", "sessions", "level"),
                    (
                        (_byte(one), SERVICE_NAMES[one], SERVICE_TEXTS[one], *_who(SERVICES[one]))
                        for one in sorted(Service)
                    ),
                ),
                "## Security access",
                _table(
                    ("seed, answer", "level", "sessions"),
                    (
                        (f"`27 {one:02X}`, `27 {one + 1:02X}`", _words(one.name), _sessions(LEVELS[one]))
                        for one in Level
                    ),
                ),
                _wrapped(f"""The seed has {SEED_LENGTH} random bytes, the answer {ANSWER_LENGTH}: the AES-CMAC of
the seed under the level's own key, which is the AES-CMAC of the access key over the letters
"{LABEL.decode()}" and the level's number, {Level.PROGRAMMING} or {Level.CALIBRATION}, in one byte ([as a
program](../how-to/flash-an-ecu.md#with-a-tester-of-your-own)). After {MAX_ATTEMPTS} wrong answers in a row the
level gives no seed for {DELAY_NS / 1e9:g} s, and again after each further one. The
count outlives a reset. On a microcontroller it is written into flash memory, of which no
sector is erased while the jets run: once there is no room left, an answer is refused as
conditions not correct until they are shut."""),
                "## Identifiers",
                _table(
                    ("number", "identifier", "holds", "written in session", "level"),
                    ((f"`{one:04X}`", _words(one.name), DID_TEXTS[one], *_writer(one)) for one in sorted(Did)),
                ),
                _wrapped("""Reading needs neither session nor level. Numbers are big-endian. A calibration is
little-endian, as [the how-to page](../how-to/calibrate.md#by-hand) describes."""),
                "## Routines",
                _table(
                    ("number", "routine", "does", "sessions", "level"),
                    (
                        (f"`{one:04X}`", _words(one.name), ROUTINE_TEXTS[one], *_who(ROUTINES[one]))
                        for one in sorted(Routine)
                    ),
                ),
                *_faults(),
                "## Verdicts",
                "The answer to the routine `FF01`: the first check that the image failed.",
                _table(("number", "verdict", "means"), ((str(one.value), one.name, one.in_words) for one in Verdict)),
                "## Negative responses",
                _table(
                    ("code", "name", "sent when"),
                    ((_byte(one), _words(one.name), NRC_TEXTS[one]) for one in Nrc if one not in UNSENT),
                ),
                "## Tools of others",
                _wrapped("""`stillwake export --for-testers FOLDER` writes all of UDS above as ODX 2.2 (ISO 22901-1):
each request and answer with its types, trouble codes and negative responses, the sessions and levels as states
that services need, and how the ECU is reached. It is made from the same tables as this page. A test has
odxtools read it, ask the running server by it, in every session, and decode the answers. The communication
parameters have the names of ISO 15765-2, 15765-3 and 11898-2; their subsets hold those alone that are used,
so a tool that has the whole standard subsets should keep its own."""),
                _wrapped("""The scanners of scapy (ISO-TP, UDS and XCP) are run against the ECU in a test: they find the
identifiers on the bus, the services, identifiers, sessions, levels and routines of these tables and no others,
and the jets stay as they are in every control period of the scan, under control and without. caringcaribou,
another scanner, is no package that could be installed, so nothing is stated about it."""),
                "## XCP",
                _wrapped(f"""XCP on CAN (ASAM MCD-1 XCP, protocol {xcp.PROTOCOL_VERSION}.x): packets of up to
{xcp.MAX_CTO} bytes, one segment of {PACKED_BYTES} bytes at address 0x{ADDRESS:X}
with two pages, no measurement (DAQ) and no flashing. Commands marked with a star
need seed and key of the resource CAL_PAG. A wrong key ends the connection. So do
{IDLE_NS // 60_000_000_000} minutes without a command."""),
                _table(
                    ("code", "command"),
                    ((_byte(one), f"{one.name}{' *' if one in xcp.PROTECTED else ''}") for one in xcp.Command),
                ),
            )
        )
        + "\n"
    )


def _faults() -> tuple[str, ...]:
    return (
        "## Faults",
        _wrapped(f"""Each reason of EcuStatus that is a fault has a code of three bytes (SAE J2012-DA). A code is
entered when the ECU goes into FAULT for its reason: [the state
machine](states.md) has debounced it then. All codes pass their test when control begins.
An operation cycle lasts from power-on to the next reset. After {AGED_CYCLES} cycles with a
passed test and no failed one a confirmed code is forgotten, with its snapshot. The memory outlives
a loss of power. It is written while no jet can run: a fault at once, as it shuts the jets. A
fault that stands while it is cleared is entered again when it begins again, or at the next
power-on."""),
        _table(
            ("code", "bytes", "reason", "found when"),
            (
                (in_letters(code), f"`{code:06X}`", reason.name, BECAUSE[reason])
                for reason, code in sorted(CODES.items())
            ),
        ),
        f"Bits of the status. All but `80`, the warning lamp, are there: the availability mask is `{AVAILABLE:02X}`.",
        _table(("bit", "status", "means"), ((_byte(one), _words(one.name or ""), STATUS_TEXTS[one]) for one in Status)),
        "The snapshot is of the first time in the latest cycle that had the fault. It has the number `01` and, in this "
        "order:",
        _table(
            ("identifier", "bytes", "holds"),
            (
                (f"`{one:04X}`", str(struct.calcsize(form)), SNAPSHOT_TEXTS[one])
                for one, form in SNAPSHOT_FORMATS.items()
            ),
        ),
        f"The extended record `01` has the age, 1 byte: passed cycles of the {AGED_CYCLES}.",
        "Service `29` (Authentication) is not there; security access is.",
    )


def _head() -> str:
    return f"""# Diagnosis

For ECU engineers with a tester or a calibration tool of their own: what an ECU that runs with `--slots` understands.
[Flash an ECU](../how-to/flash-an-ecu.md) and [calibrate](../how-to/calibrate.md) have the commands that use it, and
[protection](../explanation/protection.md) explains what the keys protect. `make generated` writes this page
from `can_bridge/uds/` and `can_bridge/calibration/`.

{_timing()}

## Identifiers on the bus

{_identifiers()}"""


def _identifiers() -> str:
    default = DiagnosisConfig()
    rows = (("`bus.diagnosis." + name + "`", getattr(default, name) or "none", text) for name, text in ID_TEXTS.items())
    unsent = ", ".join(map(_byte, sorted(services.UNSENT_TO_ALL)))
    return "\n\n".join(
        (
            _table(("setting", "default", "carries"), rows),
            _wrapped("""The defaults are for a bench. On a vehicle's bus 0x7E0 and 0x7E8 belong to the engine
(ISO 15765-4): its ECU answers there, and every scan tool asks there. Take the identifiers that the vehicle's
diagnosis plan gives this ECU. Without a plan take two free ones of 11 bits outside 0x7DF to 0x7EF, greater than the
control's, so that a tester's frames wait for pressures and commands and not the other way round; or of 29 bits the
normal fixed ones of ISO 15765-2, made of the target's and the source's address: with 0x5A for this ECU and 0xF1
for the tester, in a file for `--set`,"""),
            '```toml\n[bus.diagnosis]\nrequest_id = "0x18DA5AF1"\nresponse_id = "0x18DAF15A"\n'
            'functional_id = "0x18DB33F1"\n```',
            _wrapped("""Three digits are 11 bits, eight are 29, as candump writes them: 0x00000123 is another
identifier than 0x123, and 0x0123 is refused. `--set bus.diagnosis.request_id=0x18DA5AF1` means the same. A number
without quotation marks has no zeros in front: it has 11 bits up to 0x7FF, and 29 from 0x1000 on. One that is
taken twice, or by a message of the DBC, is refused, and so are two lengths in one conversation."""),
            _wrapped("""ECU and tester need the same settings: `ecu --slots`, `ecu --mcu`, `export --c` (constants
of `sw_ecu_settings.h`), `flash`, `diagnose`, `calibrate`, the A2L and PDX of `export --for-testers`, and the
names in `can decode` and `can monitor`. XCP is not in the ECU in C. The DBC has the messages of the control alone, and
its hash is in every release: what describes diagnosis to other tools is the PDX, and the A2L for XCP."""),
            _wrapped(f"""A functional request goes to every ECU on the bus. It has one frame; the beginning of a longer
one is passed over. It interrupts no transfer: `3E 80` keeps the session while blocks come. The refusals {unsent} are
not sent to it, unless the tester was told to wait; all other answers come as to a physical request."""),
        )
    )


def _timing() -> str:
    return _wrapped(f"""The ECU answers within {services.P2_MS} ms, or reports
that the answer is pending, and then again within {services.P2_EXTENDED_MS / 1000:g}
s each. A request has at most {services.MAX_REQUEST} bytes. Frames of diagnosis carry
no authentication, also where `bus.key` is set.""")


def _wrapped(text: str) -> str:
    return textwrap.fill(" ".join(text.split()), width=120, break_on_hyphens=False)


def _writer(did: Did) -> tuple[str, str]:
    permission = WRITABLE.get(did)
    return ("never", "") if permission is None else _who(permission)


def _who(permission: Permission) -> tuple[str, str]:
    level = permission.level
    return _sessions(permission), "" if level is None else _words(level.name)


def _sessions(permission: Permission) -> str:
    if permission.sessions == frozenset(Session):
        return "all"
    return ", ".join(_words(one.name) for one in sorted(permission.sessions))


def _words(name: str) -> str:
    return name.lower().replace("_", " ")


def _byte(number: int) -> str:
    return f"`{number:02X}`"


def _table(heads: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = (heads, ("---",) * len(heads), *rows)
    return "\n".join(
        "|" + "|".join(cells) + "|" if cells[0] == "---" else f"| {' | '.join(cells)} |" for cells in lines
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"wrote {PAGE}\n")
