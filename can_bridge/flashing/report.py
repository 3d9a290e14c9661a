"""The report on the store, for testers (`Did.STORE`). It has less than 2048 bytes. Its parts (lengths in bytes):

    "SWT1" (4)
    running slot, active slot, slot of the next boot (1 each, 0xFF for none); reason of the last boot (1, 0 for none)
    least security version (4); version of the key list (4, 0 for none)
    failed attempts for programming (1), for calibration (1)
    for each slot: phase (1), verdict (1, 0xFF for none), boots left (1), length of the name (2), security version (4),
        bytes received (4), length of the image (4), digest (32, zeros for none), name (UTF-8)

Numbers are big-endian.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from can_bridge.flashing.backing import Slot
from can_bridge.flashing.state import Level, SlotPhase
from can_bridge.flashing.store import BootReason, Store
from can_bridge.flashing.verdicts import Verdict
from contract.errors import BusError
from contract.printable import is_name, shown

_MAGIC: Final = b"SWT1"
_HEAD: Final = struct.Struct(">4sBBBBIIBB")
_SLOT: Final = struct.Struct(">BBBHIII32s")
_NONE: Final = 0xFF


@dataclass(frozen=True, kw_only=True)
class SlotReport:
    """The report on one slot: fields of `state.SlotState`, and the verdict of the last boot's check, if any."""

    phase: SlotPhase
    name: str
    digest: str
    security_version: int
    received: int
    length: int
    boots_left: int
    verdict: Verdict | None


@dataclass(frozen=True, kw_only=True)
class StoreReport:
    """The state of the store; for the fields see `Store` and `state.StoreState`. `reason` is None before the first
    boot. `key_list_version` is None without a key list."""

    slots: tuple[SlotReport, SlotReport]
    running: Slot | None
    active: Slot | None
    next_boot: Slot | None
    reason: BootReason | None
    least_security_version: int
    key_list_version: int | None
    failed_attempts: Mapping[Level, int]

    @property
    def running_slot(self) -> SlotReport | None:
        return None if self.running is None else self.slots[self.running]


def encode(store: Store) -> bytes:
    """Return the report on a store as bytes, the value of the identifier `Did.STORE`."""
    state, boot = store.state, store.last_boot
    slots = (_NONE if slot is None else slot for slot in (store.running, state.active, state.next_boot))
    reason = 0 if boot is None else boot.reason
    verdicts = {} if boot is None else boot.verdicts
    version = 0 if store.keys is None else store.keys.version
    attempts = (state.failed_attempts[level] for level in Level)
    raw = _HEAD.pack(_MAGIC, *slots, reason, state.least_security_version, version, *attempts)
    for slot, standing in zip(Slot, state.slots, strict=True):
        name = standing.name.encode()
        head = standing.phase, verdicts.get(slot, _NONE), standing.boots_left, len(name)
        numbers = standing.security_version, standing.received, standing.length
        raw += _SLOT.pack(*head, *numbers, bytes.fromhex(standing.digest)) + name
    return raw


def tree(report: StoreReport) -> dict[str, Any]:
    """Return the report as JSON values; members of enumerations are replaced by their names."""
    slots = [{name: _named(value) for name, value in vars(slot).items()} for slot in report.slots]
    attempts = {level.name: count for level, count in report.failed_attempts.items()}
    return {name: _named(value) for name, value in vars(report).items()} | {"slots": slots, "failed_attempts": attempts}


def _named(value: object) -> object:
    return value.name if isinstance(value, Enum) else value


def decode(raw: bytes) -> StoreReport:
    """Decode the bytes of a report from a bus; raises BusError if the bytes are not a report."""
    try:
        magic, *listed, reason, least, version, programming, calibration = _HEAD.unpack_from(raw)
        if magic != _MAGIC:
            raise ValueError(f"it begins with {magic.hex()}, but this version reads {_MAGIC.hex()}")
        first, at = _slot(raw, _HEAD.size)
        second, at = _slot(raw, at)
        if at != len(raw):
            raise ValueError(f"it has {len(raw)} bytes, but must have {at}")
        running, active, next_boot = (None if slot == _NONE else Slot(slot) for slot in listed)
        return StoreReport(
            slots=(first, second),
            running=running,
            active=active,
            next_boot=next_boot,
            reason=None if reason == 0 else BootReason(reason),
            least_security_version=least,
            key_list_version=version or None,
            failed_attempts={Level.PROGRAMMING: programming, Level.CALIBRATION: calibration},
        )
    except (ValueError, struct.error) as error:
        raise BusError(f"the ECU's report of its store is damaged ({shown(error)}); read the report again") from error


def _slot(raw: bytes, at: int) -> tuple[SlotReport, int]:
    phase, verdict, boots_left, size, security_version, received, length, digest = _SLOT.unpack_from(raw, at)
    at += _SLOT.size
    name = raw[at : at + size].decode()
    if len(raw) < at + size or (name and not is_name(name)):
        raise ValueError(f"its release name {name!r} is invalid")
    slot = SlotReport(
        phase=SlotPhase(phase),
        name=name,
        digest=digest.hex() if any(digest) else "",
        security_version=security_version,
        received=received,
        length=length,
        boots_left=boots_left,
        verdict=None if verdict == _NONE else Verdict(verdict),
    )
    return slot, at + size
