"""What a tester reads of the store (`Did.STORE`): strict JSON of less than `MAX_REPORT` bytes."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, TypeVar

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Slot
from can_bridge.flashing.boot import BootReason
from can_bridge.flashing.state import Phase
from can_bridge.flashing.store import Store
from can_bridge.flashing.verdicts import Verdict
from contract.errors import BusError
from contract.printable import is_name, shown
from contract.release import strict_json
from contract.release.manifest import is_sha256

SCHEMA: Final = "stillwake-store/1"
MAX_REPORT: Final = 2048
"""Bytes."""
_LARGEST: Final = 2**32 - 1

E = TypeVar("E", bound=Enum)


@dataclass(frozen=True, kw_only=True)
class SlotReport:
    """One slot; the fields are those of `state.SlotState`.

    Attributes:
        name, digest: of the release; empty where no image was checked.
        verdict: of the last boot; None if it did not look at this slot.
    """

    phase: Phase
    name: str
    digest: str
    security_version: int
    received: int
    length: int
    boots_left: int
    verdict: Verdict | None


@dataclass(frozen=True, kw_only=True)
class Report:
    """The store.

    Attributes:
        slots: by `Slot`.
        running: the slot that was booted; None without a release, or if another image was announced for it since.
        active: the slot of the confirmed release.
        next_boot: the slot that the next boot tries first.
        reason: of the last boot; None before one.
        least_security_version: that a release must have.
        key_list_version: None without a key list.
        failed_attempts: wrong keys in a row.
    """

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
        """What runs."""
        return None if self.running is None else self.slots[self.running]


def report_of(store: Store) -> Report:
    """As the store stands now."""
    state, boot = store.state, store.last_boot
    verdicts = {} if boot is None else boot.verdicts
    first, second = (
        SlotReport(
            phase=standing.phase,
            name=standing.name,
            digest=standing.digest,
            security_version=standing.security_version,
            received=standing.received,
            length=standing.length,
            boots_left=standing.boots_left,
            verdict=verdicts.get(slot),
        )
        for slot, standing in zip(Slot, state.slots, strict=True)
    )
    return Report(
        slots=(first, second),
        running=store.running,
        active=state.active,
        next_boot=state.next_boot,
        reason=None if boot is None else boot.reason,
        least_security_version=state.least_security_version,
        key_list_version=None if store.keys is None else store.keys.version,
        failed_attempts=dict(state.failed_attempts),
    )


def encode(report: Report) -> bytes:
    """The identifier's value."""
    body = {
        "schema": SCHEMA,
        "slots": [{**vars(slot), "phase": slot.phase.name, "verdict": _name(slot.verdict)} for slot in report.slots],
        "running": _name(report.running),
        "active": _name(report.active),
        "next_boot": _name(report.next_boot),
        "reason": _name(report.reason),
        "least_security_version": report.least_security_version,
        "key_list_version": report.key_list_version,
        "failed_attempts": {level.name: count for level, count in report.failed_attempts.items()},
    }
    return json.dumps(body, separators=(",", ":"), ensure_ascii=False).encode()


def decode(raw: bytes) -> Report:
    """A report that came over a bus; raises BusError if it is none."""
    try:
        if len(raw) > MAX_REPORT:
            raise ValueError(f"{len(raw)} bytes, must be at most {MAX_REPORT}")
        body = strict_json.decode(raw)
        if body.get("schema") != SCHEMA:
            raise ValueError(f"schema {body.get('schema')!r}, this version reads {SCHEMA!r}")
        if body.keys() != Report.__dataclass_fields__.keys() | {"schema"}:
            raise ValueError(f"fields {', '.join(sorted(body))}")
        first, second = map(_slot, _list(body["slots"]))
        attempts = _table(body["failed_attempts"])
        if attempts.keys() != {level.name for level in Level}:
            raise ValueError("failed_attempts must be of every level")
        version = body["key_list_version"]
        return Report(
            slots=(first, second),
            running=_member(Slot, body["running"]),
            active=_member(Slot, body["active"]),
            next_boot=_member(Slot, body["next_boot"]),
            reason=_member(BootReason, body["reason"]),
            least_security_version=_number(body["least_security_version"]),
            key_list_version=None if version is None else _number(version),
            failed_attempts={level: _number(attempts[level.name]) for level in Level},
        )
    except (ValueError, KeyError) as error:
        raise BusError(f"the ECU's report of its store is damaged ({shown(error)}); read it again") from error


def _slot(tree: object) -> SlotReport:
    table = _table(tree)
    if table.keys() != SlotReport.__dataclass_fields__.keys():
        raise ValueError(f"a slot's fields {', '.join(sorted(table))}")
    phase, name, digest = _member(Phase, table["phase"]), table["name"], table["digest"]
    if phase is None:
        raise ValueError("a slot's phase is missing")
    if not isinstance(name, str) or (name and not is_name(name)):
        raise ValueError(f"name {name!r}")
    if digest != "" and not is_sha256(digest):
        raise ValueError(f"digest {digest!r}")
    numbers = {field: _number(table[field]) for field in ("security_version", "received", "length", "boots_left")}
    return SlotReport(phase=phase, name=name, digest=digest, verdict=_member(Verdict, table["verdict"]), **numbers)


def _name(member: Enum | None) -> str | None:
    return None if member is None else member.name


def _member(kind: type[E], name: object) -> E | None:
    if name is None:
        return None
    if not isinstance(name, str) or name not in kind.__members__:
        raise ValueError(f"{kind.__name__} {name!r}")
    return kind[name]


def _number(value: object) -> int:
    if type(value) is not int or not 0 <= value <= _LARGEST:
        raise ValueError(f"{value!r} must be a whole number of 32 bits")
    return value


def _list(value: object) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(f"{value!r} must be a list")
    return value


def _table(value: object) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{value!r} must be a table")
    return value
