"""What an ECU says of itself over UDS."""

import json
from collections.abc import Mapping
from dataclasses import dataclass

from can_bridge.flashing.backing import Slot
from can_bridge.tester.asking import Asking
from can_bridge.tester.messages import RefusedError
from can_bridge.uds.services import Did, Nrc


@dataclass(frozen=True, kw_only=True)
class SlotFacts:
    """One slot."""

    phase: str
    name: str
    digest: str
    security_version: int
    received: int
    length: int
    boots_left: int


@dataclass(frozen=True, kw_only=True)
class StoreFacts:
    """Both slots."""

    slots: Mapping[Slot, SlotFacts]
    running: Slot | None
    least_security_version: int
    key_list_version: int


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
    store: StoreFacts

    @property
    def running(self) -> SlotFacts | None:
        """What the running slot holds; None if no release runs."""
        return None if self.store.running is None else self.store.slots[self.store.running]


def read_facts(asking: Asking) -> EcuFacts:
    """Ask for all of it; raises RefusedError for an answer that makes no sense."""
    return EcuFacts(
        hardware=_text(asking, Did.HARDWARE),
        serial_number=_text(asking, Did.SERIAL_NUMBER),
        software_version=_text(asking, Did.SOFTWARE_VERSION),
        dbc_sha256=asking.read(Did.DBC_SHA256).hex(),
        period_ns=int.from_bytes(asking.read(Did.PERIOD_NS), "big"),
        capacity=int.from_bytes(asking.read(Did.CAPACITY), "big"),
        store=read_store(asking),
    )


def read_store(asking: Asking) -> StoreFacts:
    """What its slots hold; raises RefusedError for an answer that makes no sense."""
    raw = asking.read(Did.STORE)
    try:
        found = json.loads(raw)
        running = found["running"]
        return StoreFacts(
            slots={slot: SlotFacts(**found["slots"][slot.name]) for slot in Slot},
            running=None if running is None else Slot[running],
            least_security_version=found["least_security_version"],
            key_list_version=found["key_list_version"],
        )
    except (ValueError, KeyError, TypeError) as error:
        raise RefusedError("say what it holds", Nrc.OUT_OF_RANGE) from error


def _text(asking: Asking, did: Did) -> str:
    return asking.read(did).decode(errors="backslashreplace")
