"""What an ECU reports of itself over UDS."""

from collections.abc import Iterator
from dataclasses import dataclass

from can_bridge.flashing import report
from can_bridge.flashing.report import StoreReport
from can_bridge.tester.asking import Asking
from can_bridge.tester.messages import WrongReleaseError
from can_bridge.uds.services import Did
from contract.release.checks import Bundle, dbc_sha256


@dataclass(frozen=True, kw_only=True)
class EcuFacts:
    """One ECU.

    Attributes:
        dbc_sha256: of the DBC whose messages it sends, in hex.
        period_ns: its control period.
        capacity: bytes of the greatest image.
    """

    hardware: str
    serial_number: str
    software_version: str
    dbc_sha256: str
    period_ns: int
    capacity: int
    store: StoreReport


def read_facts(asking: Asking) -> EcuFacts:
    """Ask for all of it; raises RefusedError for what the ECU does not report, BusError for a damaged report."""
    return EcuFacts(
        hardware=_text(asking, Did.HARDWARE),
        serial_number=_text(asking, Did.SERIAL_NUMBER),
        software_version=_text(asking, Did.SOFTWARE_VERSION),
        dbc_sha256=asking.read(Did.DBC_SHA256).hex(),
        period_ns=int.from_bytes(asking.read(Did.PERIOD_NS), "big"),
        capacity=int.from_bytes(asking.read(Did.CAPACITY), "big"),
        store=read_store(asking),
    )


def read_store(asking: Asking) -> StoreReport:
    """What its slots hold; raises BusError for a damaged report."""
    return report.decode(asking.read(Did.STORE))


def _text(asking: Asking, did: Did) -> str:
    return asking.read(did).decode(errors="backslashreplace")


def check_fits(release: Bundle, length: int, facts: EcuFacts) -> None:
    """Raises WrongReleaseError for the first thing that does not fit.

    Args:
        release: of this version's DBC, as every bundle that was loaded.
        length: of its image, bytes.
    """
    for line in _misfits(release, length, facts):
        raise WrongReleaseError(f"bundle {release.manifest.name} {line}; nothing was written")


def _misfits(release: Bundle, length: int, facts: EcuFacts) -> Iterator[str]:
    manifest = release.manifest
    period_ns = manifest.operating_point.period_ns(manifest.control_period)
    least = facts.store.least_security_version
    if release.signer is None:
        yield "is not signed, and an ECU takes signed ones alone: `stillwake bundle sign` signs it"
    if manifest.hardware not in (None, facts.hardware):
        yield f"is for hardware {manifest.hardware}, the ECU is {facts.hardware}"
    if facts.dbc_sha256 != dbc_sha256():
        yield (
            f"is for the stillwake.dbc {dbc_sha256()[:12]}, the ECU has {facts.dbc_sha256[:12]} (stillwake "
            f"{facts.software_version}): `stillwake bundle renew` of that version makes one"
        )
    if period_ns != facts.period_ns:
        yield f"has a control period of {period_ns / 1e6:g} ms, the ECU one of {facts.period_ns / 1e6:g} ms"
    if manifest.security_version < least:
        yield f"has security version {manifest.security_version}, the ECU takes {least} or greater"
    if length > facts.capacity:
        yield f"has {length} bytes, the ECU has room for {facts.capacity}"
