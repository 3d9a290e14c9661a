"""The data of a store that survive a loss of power, besides the images: state, key list, calibrations and faults."""

import hashlib
import struct
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Final

from can_bridge.flashing import state
from can_bridge.flashing.backing import Backing, Long, MediumError, RecordKind, Slot
from can_bridge.flashing.checking import Fits, ImageCheck, Release, Rules, check
from can_bridge.flashing.state import MOST_ATTEMPTS, Level, SlotState, StoreState
from can_bridge.flashing.verdicts import Verdict
from contract.errors import KeyFileError
from contract.release import key_list
from contract.release.key_list import KeyList
from contract.release.signing import PublicKey

PIECE: Final = 4096
"""Number of bytes of an image that are read or written in one call."""


class Remembered:
    """The records of a backing; a missing or damaged record counts as never stored.

    Args:
        root: public key that verifies key lists.
        fits: returns whether a release was made for this vehicle.
        check: checks an image: `checking.check` for bundles, `judge_image` for the images of microcontrollers.

    Attributes:
        keys: the keys that may sign; None without a valid list.
        faults: the fault memory's record; empty if there is none.
    """

    def __init__(
        self, backing: Backing, *, root: PublicKey, hardware: str, fits: Fits, check: ImageCheck = check
    ) -> None:
        self.backing = backing
        self._root, self._hardware, self._fits, self._check = root, hardware, fits, check
        self.state = StoreState()
        self.keys: KeyList | None = None
        self._calibrations: dict[str, bytes] = {}
        records = backing.records()
        with suppress(ValueError):
            found = state.decode(records.get(RecordKind.STATE, b""))
            if all(slot.length <= backing.capacity for slot in found.slots):
                self.state = found
        with suppress(KeyFileError):
            self.keys = key_list.decode(records.get(RecordKind.KEYS, b""), root)
        with suppress(ValueError):
            self._calibrations = decode_calibrations(records.get(RecordKind.CALIBRATION, b""))
        self.faults = records.get(RecordKind.FAULTS, b"")

    def keep(self, changed: StoreState) -> None:
        """Store a changed state. If the call raises MediumError, the state is unchanged."""
        self.backing.keep(RecordKind.STATE, state.encode(changed))
        self.state = changed

    def keep_slot(self, slot: Slot, changed: SlotState) -> None:
        self.keep(self.state.with_slot(slot, changed))

    def judged(self, slot: Slot) -> Long[tuple[Verdict, Release | None]]:
        """Read a complete image from the memory and return the result of its checks."""
        standing = self.state.slots[slot]
        image = bytearray()
        try:
            while len(image) < standing.length:
                image += self.backing.read(slot, len(image), min(PIECE, standing.length - len(image)))
                yield
        except MediumError:
            return Verdict.UNREADABLE, None
        if hashlib.sha256(image).digest() != standing.sha256:
            return Verdict.WRONG_HASH, None
        least = self.state.least_security_version
        rules = Rules(keys=self.keys, hardware=self._hardware, fits=self._fits, least_security_version=least)
        return self._check(bytes(image), rules)

    def calibration(self, digest: str) -> bytes | None:
        return self._calibrations.get(digest)

    def keep_faults(self, record: bytes) -> None:
        self.backing.keep(RecordKind.FAULTS, record)
        self.faults = record

    def keep_failed_attempts(self, level: Level, count: int) -> None:
        """Store the number of consecutive wrong keys, up to 255."""
        attempts = {**self.state.failed_attempts, level: min(count, MOST_ATTEMPTS)}
        if attempts != self.state.failed_attempts:
            self.keep(replace(self.state, failed_attempts=attempts))


MAX_CALIBRATION: Final = 1024
"""Largest length of a calibration in bytes."""
_MAGIC: Final = b"SWC1"
_HEAD: Final = struct.Struct(">4sB")
_ENTRY: Final = struct.Struct(">32sH")


def encode_calibrations(kept: Mapping[str, bytes]) -> bytes:
    """Return the record of calibrations by digest; raises ValueError for a calibration that is empty or too long."""
    parts = [_HEAD.pack(_MAGIC, len(kept))]
    for digest, blob in sorted(kept.items()):
        if not 1 <= len(blob) <= MAX_CALIBRATION:
            raise ValueError(f"the calibration {digest[:8]} has {len(blob)} bytes: must have 1 to {MAX_CALIBRATION}")
        parts.append(_ENTRY.pack(bytes.fromhex(digest), len(blob)) + blob)
    return b"".join(parts)


def decode_calibrations(raw: bytes) -> dict[str, bytes]:
    """Return the calibrations by digest; raises ValueError for a record that is damaged or that no store writes."""
    kept = {}
    try:
        _, count = _HEAD.unpack_from(raw)
        at = _HEAD.size
        for _ in range(count):
            digest, length = _ENTRY.unpack_from(raw, at)
            at += _ENTRY.size
            kept[digest.hex()] = raw[at : at + length]
            at += length
    except struct.error as error:
        raise ValueError(f"the record of calibrations ends after {len(raw)} bytes, before its last entry") from error
    if encode_calibrations(kept) != raw:
        raise ValueError(f"the record of calibrations ({len(raw)} bytes) is damaged or lacks {_MAGIC.decode()}")
    return kept
