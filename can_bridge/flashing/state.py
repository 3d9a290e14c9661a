"""The state of the store and its slots, as values and as the record `RecordKind.STATE`. Lengths are in bytes.

    "SWS1" (4)
    for each slot: phase (1), boots left (1), length of the image (4), bytes received (4), security version (4), SHA-256
        of the image (32), digest (32), signer (32), length of the name (2), name (UTF-8)
    active slot, 0xFF for none (1); least security version (4)
    failed attempts for programming (1), for calibration (1)
    CRC-32 of all bytes before it (4)

Numbers are big-endian. The record is stored after every block of a transfer, so it is short.
"""

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, Final

from can_bridge.flashing.backing import Slot
from contract.printable import is_name
from contract.release.manifest import FIRST_SECURITY_VERSION

TRIAL_BOOTS: Final = 3
"""Number of times that an activated image may boot unconfirmed; the store then returns to the confirmed image."""
MOST_ATTEMPTS: Final = 255

_MAGIC: Final = b"SWS1"
_SLOT: Final = struct.Struct(">BBIII32s32s32sH")
_REST: Final = struct.Struct(">BIBB")
_CRC: Final = struct.Struct(">I")
_NO_SLOT: Final = 0xFF


class Level(IntEnum):
    """A security level of diagnosis, with its own key; the value is the sub-function that requests the level's seed."""

    PROGRAMMING = 0x01
    CALIBRATION = 0x03


class SlotPhase(IntEnum):
    """The progress of an image in a slot."""

    EMPTY = 0
    FILLING = 1
    """The image is announced, and its first `received` bytes are stored."""
    CHECKED = 2
    """The image is complete and passed its checks."""
    TRIAL = 3
    """The image is activated: it boots from the next reset on, `boots_left` times."""
    CONFIRMED = 4
    """The image was confirmed: its release runs now, or ran before the release that runs now."""
    BAD = 5
    """The image is never booted: it failed a check, or was not confirmed during its trial."""


@dataclass(frozen=True, kw_only=True)
class SlotState:
    """The state of one slot. The fields that describe its release have defaults until the image passes its checks.

    Attributes:
        length, sha256: length of the announced image in bytes, and its SHA-256, 32 bytes.
        received: number of stored bytes; each of them survives a loss of power.
        digest: digest of the release, in hex.
        signer: public key that signed the image, 32 bytes.
    """

    phase: SlotPhase = SlotPhase.EMPTY
    length: int = 0
    sha256: bytes = b""
    received: int = 0
    digest: str = ""
    name: str = ""
    security_version: int = 0
    signer: bytes = b""
    boots_left: int = 0


_KNOWN: Final = frozenset({SlotPhase.CHECKED, SlotPhase.TRIAL, SlotPhase.CONFIRMED})
"""Phases of an image that passed its checks."""
TRANSFERRED: Final = _KNOWN | {SlotPhase.FILLING}
"""Phases in which a slot has an image, completely or in part."""


@dataclass(frozen=True, kw_only=True)
class StoreState:
    """The states of both slots, and the state common to them.

    Attributes:
        active: the slot whose confirmed image boots if no image is on trial; None if none was confirmed yet.
        least_security_version: smallest security version that a release may have; only a confirmation raises it.
    """

    slots: tuple[SlotState, SlotState] = (SlotState(), SlotState())
    active: Slot | None = None
    least_security_version: int = FIRST_SECURITY_VERSION
    failed_attempts: Mapping[Level, int] = field(default_factory=lambda: dict.fromkeys(Level, 0))

    @property
    def on_trial(self) -> Slot | None:
        return next((slot for slot in Slot if self.slots[slot].phase == SlotPhase.TRIAL), None)

    @property
    def checked(self) -> Slot | None:
        """The slot of the image that can be activated."""
        return next((slot for slot in Slot if self.slots[slot].phase == SlotPhase.CHECKED), None)

    @property
    def next_boot(self) -> Slot | None:
        """The slot that the next boot tries first."""
        trial = self.on_trial
        return trial if trial is not None and self.slots[trial].boots_left > 0 else self.active

    def with_slot(self, slot: Slot, state: SlotState, **others: Any) -> "StoreState":
        """Return a copy with a new state of one slot, and with the values of the fields in `others`."""
        a, b = self.slots
        return replace(self, slots=(state, b) if slot == Slot.A else (a, state), **others)


def encode(state: StoreState) -> bytes:
    parts = [_MAGIC]
    for slot in state.slots:
        name = slot.name.encode()
        numbers = slot.phase, slot.boots_left, slot.length, slot.received, slot.security_version
        parts.append(_SLOT.pack(*numbers, slot.sha256, bytes.fromhex(slot.digest), slot.signer, len(name)) + name)
    active = _NO_SLOT if state.active is None else state.active
    attempts = (state.failed_attempts[level] for level in Level)
    parts.append(_REST.pack(active, state.least_security_version, *attempts))
    raw = b"".join(parts)
    return raw + _CRC.pack(zlib.crc32(raw))


def decode(raw: bytes) -> StoreState:
    """Return the state in a record; raises ValueError for a record that is damaged or that no store writes."""
    body = raw[: -_CRC.size]
    if len(raw) < _CRC.size or raw[-_CRC.size :] != _CRC.pack(zlib.crc32(body)):
        raise ValueError("the state is damaged")
    if body[: len(_MAGIC)] != _MAGIC:
        raise ValueError(f"the state begins with {body[: len(_MAGIC)].hex()}: must begin with {_MAGIC.hex()}")
    try:
        first, at = _slot(body, len(_MAGIC))
        second, at = _slot(body, at)
        active, least, *attempts = _REST.unpack(body[at:])
    except struct.error as error:
        raise ValueError(f"the state has {len(raw)} bytes, which is too short or too long") from error
    active_slot = None if active == _NO_SLOT else Slot(active)
    failed = dict(zip(Level, attempts, strict=True))
    state = StoreState(slots=(first, second), active=active_slot, least_security_version=least, failed_attempts=failed)
    if least < FIRST_SECURITY_VERSION:
        raise ValueError(f"state: the least security version is {least}: must be {FIRST_SECURITY_VERSION} or more")
    if state.active is not None and state.slots[state.active].phase != SlotPhase.CONFIRMED:
        raise ValueError(f"state: slot {state.active.name} is active, but its image is not confirmed")
    if first.phase == second.phase and first.phase in (SlotPhase.CHECKED, SlotPhase.TRIAL):
        raise ValueError(f"state: both slots are {first.phase.name}, but only one may be")
    if encode(state) != raw:
        raise ValueError("the state has bytes that no store writes")
    return state


def _slot(body: bytes, at: int) -> tuple[SlotState, int]:
    phase, boots_left, length, received, security_version, sha256, digest, signer, size = _SLOT.unpack_from(body, at)
    at += _SLOT.size
    name = body[at : at + size].decode()
    slot = SlotState(
        phase=SlotPhase(phase),
        length=length,
        sha256=sha256 if length else b"",
        received=received,
        digest=digest.hex() if name else "",
        name=name,
        security_version=security_version,
        signer=signer if name else b"",
        boots_left=boots_left,
    )
    if problem := _problem(slot):
        raise ValueError(f"state: a slot is {slot.phase.name}, but has {problem}")
    return slot, at + size


def _problem(slot: SlotState) -> str:
    """Return a description of the values that no store writes in this phase; "" if there are none."""
    if slot.phase == SlotPhase.EMPTY:
        return "" if slot == SlotState() else "an image"
    is_filling, is_known = slot.phase == SlotPhase.FILLING, slot.phase in _KNOWN
    if not (slot.received <= slot.length if is_filling else slot.received == slot.length) or not slot.length:
        return f"{slot.received} of {slot.length} bytes"
    if slot.boots_left > (TRIAL_BOOTS if slot.phase == SlotPhase.TRIAL else 0):
        return f"{slot.boots_left} boots left"
    if (slot.name and (is_filling or not is_name(slot.name))) or (is_known and not slot.name):
        return f"the name {slot.name!r}"
    return f"security version {slot.security_version}, and no name" if slot.security_version and not slot.name else ""
