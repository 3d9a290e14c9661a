"""The properties that an ECU reports over UDS, its fault memory, and the check that a bundle fits the ECU."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from can_bridge.flashing import report
from can_bridge.flashing.report import StoreReport
from can_bridge.tester.asking import Asking
from can_bridge.tester.messages import WrongReleaseError
from can_bridge.uds.fault_memory import REASON_BY_CODE, Snapshot, Status
from can_bridge.uds.services import Did
from can_bridge.wire.messages import Mode, Reason
from contract.errors import FlashError
from contract.release.checks import Bundle, dbc_sha256


@dataclass(frozen=True, kw_only=True)
class EcuFacts:
    """The properties of one ECU. `dbc_sha256` is its DBC's hash, and `capacity` the largest image's size in bytes."""

    hardware: str
    serial_number: str
    software_version: str
    dbc_sha256: str
    period_ns: int
    capacity: int
    store: StoreReport


def read_facts(asking: Asking) -> EcuFacts:
    """Read all properties. Raises RefusedError if one is missing, FlashError or BusError for an unexpected value."""
    return EcuFacts(
        hardware=_text(asking, Did.HARDWARE),
        serial_number=_text(asking, Did.SERIAL_NUMBER),
        software_version=_text(asking, Did.SOFTWARE_VERSION),
        dbc_sha256=asking.read(Did.DBC_SHA256).hex(),
        period_ns=asking.number(Did.PERIOD_NS, 8),
        capacity=asking.number(Did.CAPACITY, 4),
        store=read_store(asking),
    )


def read_store(asking: Asking) -> StoreReport:
    """Read the report on the ECU's slots; raises BusError if the report is damaged."""
    return report.decode(asking.read(Did.STORE))


def _text(asking: Asking, did: Did) -> str:
    return asking.read(did).decode(errors="backslashreplace")


def check_fits(release: Bundle, length: int, facts: EcuFacts) -> None:
    """Raise WrongReleaseError if a property of the release does not fit the ECU. `length` is the size of the release's
    image in bytes. The bundle has this program's own DBC, because no other bundle can be loaded."""
    for line in _misfits(release, length, facts):
        raise WrongReleaseError(f"bundle {release.manifest.name} {line}; nothing was written")


def _misfits(release: Bundle, length: int, facts: EcuFacts) -> Iterator[str]:
    manifest = release.manifest
    period_ns = manifest.operating_point.period_ns(manifest.control_period)
    least = facts.store.least_security_version
    if release.signer is None:
        yield "is not signed, and an ECU accepts only signed bundles: `stillwake bundle sign` signs it"
    if manifest.hardware not in (None, facts.hardware):
        yield f"is for hardware {manifest.hardware}, but the ECU has {facts.hardware}"
    if facts.dbc_sha256 != dbc_sha256():
        yield (
            f"is for the stillwake.dbc {dbc_sha256()[:12]}, but the ECU has {facts.dbc_sha256[:12]} (stillwake "
            f"{facts.software_version}): `stillwake bundle renew` of that version makes a bundle for it"
        )
    if period_ns != facts.period_ns:
        yield f"has a control period of {period_ns / 1e6:g} ms, but the ECU has {facts.period_ns / 1e6:g} ms"
    if manifest.security_version < least:
        yield f"has security version {manifest.security_version}, but the ECU accepts {least} or greater"
    if length > facts.capacity:
        yield f"has {length} bytes, but the ECU has room for {facts.capacity}"


_ENTERED = Status.PENDING | Status.CONFIRMED | Status.TEST_FAILED


@dataclass(frozen=True, kw_only=True)
class StoredFault:
    """A trouble code that is or was present: a number of three bytes. `age` is the number of operation cycles without
    the fault since it was last found. The last five fields are the stored snapshot; None without a snapshot."""

    code: int
    reason: Reason
    status: Status
    age: int
    time_ms: int | None = None
    mode_before: Mode | None = None
    missed: int | None = None
    overruns: int | None = None
    pressures_cp: tuple[float, ...] | None = None


def read_faults(asking: Asking) -> list[StoredFault]:
    """Return all codes that are pending, confirmed or present; raises FlashError for unknown codes."""
    found = asking.faults("get_dtc_by_status_mask", int(_ENTERED))
    return [_read_one(asking, int(dtc.id), int(dtc.status.get_byte_as_int())) for dtc in found]


def _read_one(asking: Asking, code: int, status: int) -> StoredFault:
    try:
        reason = REASON_BY_CODE[code]
        snapshots = asking.faults("get_dtc_snapshot_by_dtc_number", code)[0].snapshots
        extended = asking.faults("get_dtc_extended_data_by_dtc_number", code, data_size=1)[0].extended_data
        kept: dict[int, Any] = {int(one.did): one.data for one in snapshots}
        moment = {each.name.lower(): kept[each][0] for each in Snapshot if kept and each is not Snapshot.PRESSURES_CP}
        if kept:
            moment |= {"mode_before": Mode(kept[Snapshot.MODE_BEFORE][0]), "pressures_cp": kept[Snapshot.PRESSURES_CP]}
        age = extended[0].raw_data[0] if extended else 0
        return StoredFault(code=code, reason=reason, status=Status(status), age=age, **moment)
    except (KeyError, IndexError, ValueError) as error:
        raise FlashError(f"the ECU has the fault {code:06X} of another version of stillwake ({error})") from error
