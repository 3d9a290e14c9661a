"""What an ECU reports of itself over UDS."""

from dataclasses import dataclass

from can_bridge.flashing import report
from can_bridge.flashing.report import Report
from can_bridge.tester.asking import Asking
from can_bridge.uds.services import Did


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
    store: Report


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


def read_store(asking: Asking) -> Report:
    """What its slots hold; raises BusError for a damaged report."""
    return report.decode(asking.read(Did.STORE))


def _text(asking: Asking, did: Did) -> str:
    return asking.read(did).decode(errors="backslashreplace")
