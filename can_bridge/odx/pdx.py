"""The files for testers: the PDX file (ISO 22901-1), an archive of diagnostic layers, bus parameters, a flash sequence
and a catalogue; and the rule by which a key is computed from a seed, for authors of a seed-and-key library."""

import io
import json
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import version
from importlib.resources import files
from string import Template
from typing import Final, NamedTuple
from xml.sax.saxutils import escape

from can_bridge.flashing.state import Level
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds import services
from can_bridge.uds.fault_memory import AVAILABLE, CODES, J2012_FORMAT, FaultReport, Snapshot, in_letters
from can_bridge.uds.security import ANSWER_LENGTH, DELAY_NS, LABEL, MAX_ATTEMPTS, SEED_LENGTH, AccessKey
from can_bridge.uds.services import POSITIVE, Did, Nrc, Permission, Routine, Service, Session
from can_bridge.wire.messages import SENSORS, Mode, Reason
from contract.config.diagnosis import CanId
from contract.config.vehicle import BusConfig
from contract.controller.calibration import CALIBRATION_NAMES

CODED: Final = (
    '<DIAG-CODED-TYPE BASE-DATA-TYPE="A_UINT32" xsi:type="STANDARD-LENGTH-TYPE">'
    "<BIT-LENGTH>{}</BIT-LENGTH></DIAG-CODED-TYPE>"
)


def named(tag: str, name: str, *parts: str, prefix: str = "") -> str:
    """Return an element with a short name; its identifier is the prefix followed by this name."""
    return f'<{tag} ID="{prefix}{name}"><SHORT-NAME>{name}</SHORT-NAME>{"".join(parts)}</{tag}>'


def constant(name: str, value: int, bits: int = 8) -> str:
    inner = f"<SHORT-NAME>{name}</SHORT-NAME><CODED-VALUE>{value}</CODED-VALUE>{CODED.format(bits)}"
    return f'<PARAM xsi:type="CODED-CONST">{inner}</PARAM>'


def value(name: str, of: str) -> str:
    return f'<PARAM xsi:type="VALUE"><SHORT-NAME>{name}</SHORT-NAME><DOP-REF ID-REF="{of}"/></PARAM>'


def repeated(name: str) -> str:
    """Return a parameter that repeats the first byte of the request."""
    inner = f"<SHORT-NAME>{name}</SHORT-NAME><REQUEST-BYTE-POS>0</REQUEST-BYTE-POS><BYTE-LENGTH>1</BYTE-LENGTH>"
    return f'<PARAM xsi:type="MATCHING-REQUEST-PARAM">{inner}</PARAM>'


def message(tag: str, name: str, parts: Iterable[str]) -> str:
    """Return an element with parameters: a structure, a request or an answer."""
    return named(tag, name, f"<PARAMS>{''.join(parts)}</PARAMS>", prefix=f"{tag}." if tag != "STRUCTURE" else "")


def texts(name: str, by_number: Mapping[int, str]) -> str:
    """Return a one-byte type whose values have names."""
    scales = "".join(
        f"<COMPU-SCALE><LOWER-LIMIT>{number}</LOWER-LIMIT><UPPER-LIMIT>{number}</UPPER-LIMIT>"
        f"<COMPU-CONST><VT>{escape(text)}</VT></COMPU-CONST></COMPU-SCALE>"
        for number, text in by_number.items()
    )
    method = f"<COMPU-INTERNAL-TO-PHYS><COMPU-SCALES>{scales}</COMPU-SCALES></COMPU-INTERNAL-TO-PHYS>"
    return named(
        "DATA-OBJECT-PROP",
        name,
        f"<COMPU-METHOD><CATEGORY>TEXTTABLE</CATEGORY>{method}</COMPU-METHOD>{CODED.format(8)}",
        '<PHYSICAL-TYPE BASE-DATA-TYPE="A_UNICODE2STRING"/>',
    )


def service(name: str, semantic: str, states: Iterable[str]) -> str:
    """Return a service that refers to the request and the answer of the same name, and to the states that permit it."""
    needed = "".join(f'<PRE-CONDITION-STATE-REF ID-REF="{state}"/>' for state in states)
    return (
        f'<DIAG-SERVICE ID="service.{name}" SEMANTIC="{semantic}" ADDRESSING="PHYSICAL">'
        f"<SHORT-NAME>{name}</SHORT-NAME><PRE-CONDITION-STATE-REFS>{needed}</PRE-CONDITION-STATE-REFS>"
        f'<REQUEST-REF ID-REF="REQUEST.{name}"/>'
        f'<POS-RESPONSE-REFS><POS-RESPONSE-REF ID-REF="POS-RESPONSE.{name}"/></POS-RESPONSE-REFS></DIAG-SERVICE>'
    )


def chart(name: str, semantic: str, states: Iterable[str]) -> str:
    """Return a state chart that begins in the first of its states."""
    first, *_ = listed = list(states)
    inner = "".join(named("STATE", state) for state in listed)
    return named(
        "STATE-CHART",
        name,
        f'<SEMANTIC>{semantic}</SEMANTIC><START-STATE-SNREF SHORT-NAME="{first}"/><STATES>{inner}</STATES>',
    )


DID_TYPES: Final[Mapping[Did, str]] = {
    Did.ACTIVE_SESSION: "session",
    **dict.fromkeys((Did.SERIAL_NUMBER, Did.HARDWARE, Did.SOFTWARE_VERSION), "text"),
    Did.DBC_SHA256: "bytes_32",
    Did.STORE: "bytes",
    **dict.fromkeys((Did.KEY_LIST, Did.CAPACITY), "u32"),
    Did.PERIOD_NS: "bytes_8",
    Did.CALIBRATION: "calibration",
    Did.CALIBRATION_LIMITS: "calibration_limits",
    Did.CALIBRATION_STORED: "u8",
}
"""Type of each identifier's value when it is read. A written value has the same type, except for the key list."""
_OPTIONS: Final = {Routine.ERASE: (value("length", "u32"), value("sha256", "bytes_32"))}
_STATUSES: Final = {Routine.ERASE: (value("offset", "u32"),), Routine.CHECK: (value("verdict", "verdict"),)}


class Described(NamedTuple):
    """A service with one sub-function or identifier. In the request and the answer, the service identifier is followed
    by `constants`, with 8 bits, or 16 bits for 256 and more, and these by the parameters of the `request` or `answer`.
    `at` is the permission; None for the permission of the whole service."""

    name: str
    service: Service
    constants: tuple[int, ...] = ()
    request: tuple[str, ...] = ()
    answer: tuple[str, ...] = ()
    at: Permission | None = None


def described() -> Iterator[Described]:
    """Yield all services, from the tables that the server itself uses."""
    timing = (value("p2_ms", "u16"), value("p2_star_10_ms", "u16"))
    for session in Session:
        yield Described(f"session_{session.name}", Service.SESSION, (session,), answer=timing)
    yield Described("reset_hard", Service.RESET, (1,))
    yield Described("clear_faults", Service.CLEAR_FAULTS, request=(value("group", "u24"),))
    mask, available, faults = value("mask", "u8"), constant("available", AVAILABLE), value("faults", "faults")
    code, record = (value("code", "code"), value("status", "u8")), (value("code", "code"), value("record", "u8"))
    for report, request, answer in (
        (FaultReport.COUNT, (mask,), (available, constant("form", J2012_FORMAT), value("count", "u16"))),
        (FaultReport.BY_STATUS, (mask,), (available, faults)),
        (FaultReport.SNAPSHOT, record, (*code, value("snapshots", "snapshots"))),
        (FaultReport.EXTENDED, record, (*code, value("records", "extendeds"))),
        (FaultReport.SUPPORTED, (), (available, faults)),
    ):
        yield Described(f"faults_{report.name}", Service.REPORT_FAULTS, (report,), request, answer)
    for did, of in DID_TYPES.items():
        yield Described(f"read_{did.name}", Service.READ, (did,), answer=(value("value", of),))
    for level in Level:
        seed, key, at = (value("seed", "bytes_16"),), (value("key", "bytes_16"),), services.LEVELS[level]
        yield Described(f"seed_{level.name}", Service.SECURITY, (level,), answer=seed, at=at)
        yield Described(f"key_{level.name}", Service.SECURITY, (level + 1,), request=key, at=at)
    for name, number in (("enable_sending", 0), ("disable_sending", 1)):
        yield Described(name, Service.COMMUNICATION, (number,), request=(value("kind", "u8"),))
    for number, at in services.WRITABLE.items():
        did = Did(number)
        of = "bytes" if did is Did.KEY_LIST else DID_TYPES[did]
        yield Described(f"write_{did.name}", Service.WRITE, (did,), request=(value("value", of),), at=at)
    for number, at in services.ROUTINES.items():
        routine = Routine(number)
        both = _OPTIONS.get(routine, ()), _STATUSES.get(routine, ())
        yield Described(f"routine_{routine.name}", Service.ROUTINE, (1, routine), *both, at)
    place = (constant("plain", 0x00), constant("sizes", 0x44), value("offset", "u32"), value("length", "u32"))
    block = (constant("size", 0x20), value("block", "u16"))
    yield Described("download", Service.DOWNLOAD, request=place, answer=block)
    counter = value("counter", "u8")
    yield Described("transfer", Service.TRANSFER, request=(counter, value("data", "bytes")), answer=(counter,))
    yield Described("exit", Service.EXIT)
    yield Described("tester_present", Service.TESTER_PRESENT, (0,))
    for name, number in (("faults_on", 1), ("faults_off", 2)):
        yield Described(name, Service.FAULT_SETTING, (number,))


_SNAPSHOT_TYPES: Final = dict(zip(Snapshot, (["u32"], ["mode"], ["u16"], ["u16"], SENSORS * ["f32"]), strict=True))


def pdx(bus: BusConfig, because: Mapping[Reason, str]) -> bytes:
    """Return the file's content for an ECU on this bus; `because` has the texts of the trouble codes."""
    packed = io.BytesIO()
    listed = {file.name: file.read_text(encoding="utf-8") for file in files(__package__).joinpath("files").iterdir()}
    with zipfile.ZipFile(packed, "w") as archive:
        for name, text in sorted(listed.items()):
            # Each file gets the earliest time that the format can state, so that equal descriptions give equal bytes.
            filled = Template(text).substitute(_filling(bus, because)) if name.startswith("stillwake.") else text
            archive.writestr(zipfile.ZipInfo(name), filled, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def _filling(bus: BusConfig, because: Mapping[Reason, str]) -> dict[str, object]:
    every = [one._replace(name=one.name.lower()) for one in described()]
    is_fd, ids, software = bus.frames == "fd", bus.diagnosis, version("stillwake")
    return {
        "software": escape(software),
        "variant": re.sub(r"\W", "_", software),
        "codes": "".join(_code(reason, code, because[reason]) for reason, code in CODES.items()),
        "texts": texts("session", {one: one.name.lower() for one in Session})
        + texts("nrc", {one: one.name.lower().replace("_", " ") for one in Nrc})
        + texts("verdict", {one: one.in_words for one in Verdict})
        + texts("mode", {one: one.name for one in Mode}),
        "structures": "".join(_structures()),
        "services": "".join(service(one.name, one.service.name, _states(one)) for one in every),
        "requests": "".join(message("REQUEST", one.name, (*_head(one), *one.request)) for one in every),
        "answers": "".join(message("POS-RESPONSE", one.name, (*_head(one, POSITIVE), *one.answer)) for one in every),
        "refusal": constant("sid", 0x7F) + repeated("service") + value("code", "nrc"),
        "charts": chart("session_chart", "SESSION", map(_state, Session))
        + chart("level_chart", "SECURITY", ["level_locked", *map(_state, Level)]),
        "id_bits": 29 if ids.request.is_extended else 11,
        "request_id": ids.request.number,
        "response_id": ids.response.number,
        "functional": "" if ids.functional is None else _functional(ids.functional),
        "frame_length": "TX_DL = 64 (CANFD)" if is_fd else "TX_DL = 8 (CAN)",
        "p2_us": services.P2_MS * 1000,
        "p2_star_us": services.P2_EXTENDED_MS * 1000,
        "present_us": services.S3_MS * 500,
        "nominal_bitrate": bus.nominal_bitrate,
        "data_bitrate": bus.data_bitrate if is_fd else bus.nominal_bitrate,
    }


def _functional(used: CanId) -> str:
    values = {"Format": f"normal segmented {29 if used.is_extended else 11}-bit transmit with FC", "Id": used.number}
    return "".join(
        f'<COMPARAM-REF ID-REF="CP_CanFuncReq{name}" DOCREF="ISO_15765_2" DOCTYPE="COMPARAM-SUBSET">'
        f"<SIMPLE-VALUE>{value}</SIMPLE-VALUE></COMPARAM-REF>"
        for name, value in values.items()
    )


def _code(reason: Reason, code: int, text: str) -> str:
    display = f"<DISPLAY-TROUBLE-CODE>{in_letters(code)}</DISPLAY-TROUBLE-CODE>"
    described = f"<TEXT>{reason.name}: {escape(text)}</TEXT>"
    name = in_letters(code).replace("-", "_")
    return named("DTC", name, f"<TROUBLE-CODE>{code}</TROUBLE-CODE>", display, described)


def _structures() -> Iterator[str]:
    floats = (value(name, "f32_little") for name in CALIBRATION_NAMES[:-1])
    yield message("STRUCTURE", "calibration", (*floats, value(CALIBRATION_NAMES[-1], "u32_little")))
    limits = (value(name, "calibration") for name in ("least", "greatest", "release"))
    yield message("STRUCTURE", "calibration_limits", limits)
    yield message("STRUCTURE", "fault", (value("code", "code"), value("status", "u8")))
    kept = [value("record", "u8"), constant("identifiers", len(Snapshot))]
    for one, types in _SNAPSHOT_TYPES.items():
        kept.append(constant(f"identifier_{one:04X}", one, 16))
        kept += (value(f"{one.name.lower()}_{place}", of) for place, of in enumerate(types))
    yield message("STRUCTURE", "snapshot", kept)
    yield message("STRUCTURE", "extended", (value("record", "u8"), value("age", "u8")))


def _head(one: Described, more: int = 0) -> Iterator[str]:
    yield constant("sid", one.service + more)
    for place, number in enumerate(one.constants):
        yield constant(f"constant_{place}", number, 8 if number < 256 else 16)


def _states(one: Described) -> Iterator[str]:
    whole = services.SERVICES[one.service]
    permission = one.at or whole
    yield from map(_state, sorted(permission.sessions & whole.sessions))
    if permission.level is not None:
        yield _state(permission.level)


def _state(one: Session | Level) -> str:
    return f"{type(one).__name__}_{one.name}".lower()


SEED_AND_KEY: Final = "seed_and_key.json"
EXAMPLE: Final = bytes(range(16))
"""The bytes of both the access key and the seed in each known answer. No ECU uses this access key."""
_LIBRARY: Final = {
    "function": "GenerateKeyEx",
    "prototype": "int GenerateKeyEx(const unsigned char *seed, unsigned int seed_length, unsigned int level, "
    "const char *variant, unsigned char *key, unsigned int key_capacity, unsigned int *key_length)",
    "level": "number of the level below",
    "variant": "not used: the library's maker keeps an access key for each ECU",
    "returns": {"0": "key computed", "1": "key_capacity too small", "2": "level unknown", "4": "other error"},
}
"""The interface of the seed-and-key library that testers load. Tools for Windows expect a DLL with this function."""


def seed_and_key() -> bytes:
    """Return the rule by which a key is computed from a seed, as JSON; it contains no secret."""
    example = AccessKey(EXAMPLE)
    levels = [
        {
            "name": one.name.lower(),
            "level": int(one),
            "request_seed": f"27 {one:02X}",
            "send_key": f"27 {one + 1:02X}",
            "sessions": sorted(f"10 {session:02X}" for session in services.LEVELS[one].sessions),
            "known_answer": dict.fromkeys(("access_key", "seed"), EXAMPLE.hex())
            | {"key": example.answer(one, EXAMPLE).hex()},
        }
        for one in Level
    ]
    described = {
        "algorithm": "AES-CMAC (RFC 4493) with keys of 128 bits",
        "level_key": "AES-CMAC(access key, label followed by the level in one byte)",
        "key": "AES-CMAC(level_key, seed)",
        "label_hex": LABEL.hex(),
        "access_key_bytes": len(EXAMPLE),
        "seed_bytes": SEED_LENGTH,
        "key_bytes": ANSWER_LENGTH,
        "seed_of_zeros": "the level is unlocked already: send no key",
        "attempts": MAX_ATTEMPTS,
        "delay_s": DELAY_NS / 1e9,
        "levels": levels,
        "library": _LIBRARY,
    }
    return (json.dumps(described, indent=2) + "\n").encode()
