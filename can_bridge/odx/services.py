"""Every request that the ECU knows, with its answer and who may send it: from the tables of `can_bridge.uds`."""

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from can_bridge.flashing.access_level import Level
from can_bridge.odx.xml import constant, value
from can_bridge.uds.fault_codes import J2012_FORMAT
from can_bridge.uds.fault_memory import AVAILABLE
from can_bridge.uds.fault_reports import Report
from can_bridge.uds.permissions import LEVELS, ROUTINES, SERVICES, WRITABLE, Permission
from can_bridge.uds.services import Did, Routine, Service, Session

DID_TYPES: Final[Mapping[Did, str]] = {
    Did.ACTIVE_SESSION: "session",
    Did.SERIAL_NUMBER: "text",
    Did.HARDWARE: "text",
    Did.SOFTWARE_VERSION: "text",
    Did.DBC_SHA256: "bytes_32",
    Did.STORE: "bytes",
    Did.KEY_LIST: "u32",
    Did.CAPACITY: "u32",
    Did.PERIOD_NS: "bytes_8",
    Did.CALIBRATION: "calibration",
    Did.CALIBRATION_LIMITS: "calibration_limits",
    Did.CALIBRATION_STORED: "u8",
}
"""Of each identifier as it is read. All but the key list are written in the same form."""
_OPTIONS: Final = {Routine.ERASE: (value("length", "u32"), value("sha256", "bytes_32"))}
_STATUSES: Final = {Routine.ERASE: (value("offset", "u32"),), Routine.CHECK: (value("verdict", "verdict"),)}


class Described(NamedTuple):
    """One service with one sub-function or identifier.

    Attributes:
        constants: numbers and their bits, behind the service's in the request, and in the answer again.
        request, answer: parameters behind those.
    """

    name: str
    service: Service
    permission: Permission
    constants: tuple[tuple[int, int], ...] = ()
    request: tuple[str, ...] = ()
    answer: tuple[str, ...] = ()


def described() -> Iterator[Described]:
    """All of them, by the tables that the server works with."""

    def one(
        name: str,
        service: Service,
        *numbers: int,
        bits: int = 8,
        at: Permission | None = None,
        request: tuple[str, ...] = (),
        answer: tuple[str, ...] = (),
    ) -> Described:
        constants = tuple((number, bits) for number in numbers)
        return Described(name.lower(), service, at or SERVICES[service], constants, request, answer)

    timing = (value("p2_ms", "u16"), value("p2_star_10_ms", "u16"))
    for session in Session:
        yield one(f"session_{session.name}", Service.SESSION, session, answer=timing)
    yield one("reset_hard", Service.RESET, 1)
    yield one("clear_faults", Service.CLEAR_FAULTS, request=(value("group", "u24"),))
    for report, request, answer in _reports():
        yield one(f"faults_{report.name}", Service.REPORT_FAULTS, report, request=request, answer=answer)
    for did, of in DID_TYPES.items():
        yield one(f"read_{did.name}", Service.READ, did, bits=16, answer=(value("value", of),))
    for level in Level:
        at = LEVELS[level]
        yield one(f"seed_{level.name}", Service.SECURITY, level, at=at, answer=(value("seed", "bytes_16"),))
        yield one(f"key_{level.name}", Service.SECURITY, level + 1, at=at, request=(value("key", "bytes_16"),))
    for name, number in (("enable_sending", 0), ("disable_sending", 1)):
        yield one(name, Service.COMMUNICATION, number, request=(value("kind", "u8"),))
    for number, at in WRITABLE.items():
        did = Did(number)
        of = "bytes" if did is Did.KEY_LIST else DID_TYPES[did]
        yield one(f"write_{did.name}", Service.WRITE, did, bits=16, at=at, request=(value("value", of),))
    for number, at in ROUTINES.items():
        routine = Routine(number)
        both = _OPTIONS.get(routine, ()), _STATUSES.get(routine, ())
        yield Described(f"routine_{routine.name.lower()}", Service.ROUTINE, at, ((1, 8), (routine, 16)), *both)
    place = (constant("plain", 0x00), constant("sizes", 0x44), value("offset", "u32"), value("length", "u32"))
    yield one("download", Service.DOWNLOAD, request=place, answer=(constant("size", 0x20), value("block", "u16")))
    counter = value("counter", "u8")
    yield one("transfer", Service.TRANSFER, request=(counter, value("data", "bytes")), answer=(counter,))
    yield one("exit", Service.EXIT)
    yield one("tester_present", Service.TESTER_PRESENT, 0)
    for name, number in (("faults_on", 1), ("faults_off", 2)):
        yield one(name, Service.FAULT_SETTING, number)


def _reports() -> Iterator[tuple[Report, tuple[str, ...], tuple[str, ...]]]:
    mask, available, faults = value("mask", "u8"), constant("available", AVAILABLE), value("faults", "faults")
    yield Report.COUNT, (mask,), (available, constant("form", J2012_FORMAT), value("count", "u16"))
    yield Report.BY_STATUS, (mask,), (available, faults)
    code, record = (value("code", "code"), value("status", "u8")), (value("code", "code"), value("record", "u8"))
    yield Report.SNAPSHOT, record, (*code, value("snapshots", "snapshots"))
    yield Report.EXTENDED, record, (*code, value("records", "extendeds"))
    yield Report.SUPPORTED, (), (available, faults)
