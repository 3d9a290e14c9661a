"""Records that nobody wrote: right in their frame, with values at and beyond all limits, in any order in both sectors.

Both stores boot from each, and are asked for more. A record with a value that no store writes counts as none: the jets
then stay shut until a release is flashed, and no value decides on what boots.
"""

import hashlib
import struct
import zlib
from collections.abc import Sequence
from random import Random
from typing import Any, Final

from can_bridge.flashing.backing import MAX_RECORD, RecordKind
from can_bridge.flashing.remembered import MAX_CALIBRATION
from can_bridge.flashing.state import SlotPhase
from contract.release import signing
from tests.can_bridge.flashing.releases import RELEASE, SECOND
from tests.proofs.loader_in_c.store_library import GOOD, LONG, SECTOR, SLOT_BYTES, WORD, Library
from tests.proofs.loader_in_c.store_pair import Pair
from tests.proofs.loader_in_c.store_stories import LISTS, flash, provision, transfer

_NAMES: Final = (
    *(3 * [b""]), b"one", b"n" * 64, b"n" * 101, b"n" * 300, b"\0", b"a\nb", b"one\0", b"\x7f", b"\xff", b" ",
)  # fmt: skip
"""Not those that only one kind of image may have: a bundle's name has up to 100 characters, and other than ASCII."""
_COUNTS: Final = (0, 0, 0, 1, 3, 4, 255)
_VERSIONS: Final = (0, 1, 2, 2**31, 2**32 - 1)
_SEQUENCES: Final = (0, 1, 2, 2**31 - 1, 2**31, 2**31 + 1, 2**32 - 2, 2**32 - 1)
_AFTER: Final = ("confirm", "revert", "activate", "finish", "calibrate", "transfer")
_HEAD: Final = b"\xc3SW1"
_DIGESTS: Final = tuple(sorted(hashlib.sha256(name.encode()).digest() for name in (*GOOD, "x")))


def sealed(body: bytes) -> bytes:
    return body + struct.pack(">I", zlib.crc32(body))


def _slot(rng: Random, own: str) -> bytes:
    """A slot as a store writes it, most often with its own image, with up to two fields that are drawn."""
    name, whole = (own, GOOD[own]) if rng.random() < 0.7 else rng.choice((*GOOD.items(), ("long", LONG)))
    digest, signer = (hashlib.sha256(name.encode()).digest(), signing.public_key(rng.choice((RELEASE, SECOND))).raw)
    phase = rng.choice((*SlotPhase, SlotPhase.CONFIRMED, SlotPhase.CONFIRMED, SlotPhase.TRIAL))
    is_filling, is_empty = phase == SlotPhase.FILLING, phase == SlotPhase.EMPTY
    length = 0 if is_empty else len(whole)
    received = rng.choice((0, 64, 100, length)) if is_filling else length
    is_known = not is_filling and not is_empty and (phase != SlotPhase.BAD or rng.random() < 0.5)
    fields: dict[str, Any] = {
        "phase": int(phase), "boots": rng.randrange(4) if phase == SlotPhase.TRIAL else 0, "length": length,
        "received": received, "version": rng.choice((1, 2)) if is_known else 0,
        "sha256": bytes(32) if is_empty else hashlib.sha256(whole).digest(),
        "digest": digest if is_known else bytes(32), "signer": signer if is_known else bytes(32),
        "name": name.encode() if is_known else b"",
    }  # fmt: skip
    drawn: dict[str, tuple[Any, ...]] = {
        "phase": (0, 1, 2, 3, 4, 5, 6, 255), "boots": _COUNTS, "version": _VERSIONS, "name": _NAMES,
        "length": (0, 1, length + 1, received, SLOT_BYTES, SLOT_BYTES + 1, 2**31, 2**32 - 1),
        "received": (0, 1, max(length - 1, 0), length, length + 1, 2**32 - 1),
        "sha256": (bytes(32), rng.randbytes(32)), "digest": (bytes(32), digest), "signer": (bytes(32), signer),
    }  # fmt: skip
    for field in rng.sample(list(drawn), k=rng.choice((0, 0, 0, 1, 1, 2))):
        fields[field] = rng.choice(drawn[field])
    *numbers, name_bytes = fields.values()
    size = len(name_bytes) if rng.random() < 0.97 else rng.choice((0, 1, 256 + len(name_bytes), 2**16 - 1))
    return struct.pack(">BBIII32s32s32sH", *numbers, size) + bytes(name_bytes)


def any_state(rng: Random) -> bytes:
    """A record of the state, most often with a right CRC-32."""
    active = rng.choice((0, 1, 0xFF)) if rng.random() < 0.9 else rng.choice((2, 0xFE))
    least, attempts = rng.choice((1, 1, 2, *_VERSIONS)), [rng.choice(_COUNTS) for _ in range(2)]
    body = b"SWS1" + _slot(rng, "one") + _slot(rng, "two") + struct.pack(">BIBB", active, least, *attempts)
    if rng.random() < 0.05:
        body = rng.choice((b"SWS2" + body[4:], body + b"\0", body[:-1], body[: rng.randrange(len(body))]))
    return sealed(body) if rng.random() < 0.97 else body + rng.randbytes(4)


def any_calibrations(rng: Random) -> bytes:
    """A record of calibrations, with digests in any order, twice, or of no release here."""
    digests = rng.choices(_DIGESTS, k=rng.choice((0, 1, 2, 2, 3)))
    if rng.random() < 0.6:
        digests = sorted(set(digests))
    body = b""
    for digest in digests:
        size = rng.choice((1, 24, 100, MAX_CALIBRATION)) if rng.random() < 0.8 else rng.choice((0, MAX_CALIBRATION + 1))
        body += digest + struct.pack(">H", size) + bytes(size if rng.random() < 0.95 else max(size - 1, 0))
    count = len(digests) if rng.random() < 0.8 else rng.choice((0, len(digests) + 1, 255))
    return rng.choice((*9 * [b"SWC1"], b"SWC2")) + bytes([count]) + body + (b"" if rng.random() < 0.8 else b"\0")


def any_record(rng: Random) -> tuple[RecordKind, bytes]:
    kind = rng.choice((*5 * [RecordKind.STATE], *2 * [RecordKind.CALIBRATION], RecordKind.KEYS, RecordKind.FAULTS))
    faults = rng.randbytes(rng.choice((0, 1, 24, 25, 300)))
    of = {RecordKind.CALIBRATION: any_calibrations, RecordKind.KEYS: lambda rng: rng.choice(LISTS)}
    return kind, faults if kind == RecordKind.FAULTS else of.get(kind, any_state)(rng)


def forged(pair: Pair, seed: str, records: int) -> tuple[int, int]:
    """Both stores on so many records in turn, and what may follow: their number, and after how many a release ran."""
    rng, run = Random(f"forged {seed}"), 0
    good = b""
    for number in range(records):
        kind, raw = any_record(rng)
        if number % 20 == 0:
            pair.plant(RecordKind.STATE, b"")
            pair.call("take_keys", LISTS[4])
            provision(pair)
            flash(pair, GOOD["two"])
            good = pair.flash.kept[RecordKind.STATE]
        elif kind != RecordKind.STATE:
            pair.plant(RecordKind.STATE, good)
        pair.plant(kind, raw, rng.randbytes(2 * WORD))
        run += pair.store.running is not None
        for name in rng.sample(_AFTER, k=rng.randrange(3)):
            if name == "calibrate":
                pair.call("keep_calibration", rng.randbytes(rng.choice((0, 24))))
            elif name == "transfer":
                whole = rng.choice((*GOOD.values(), LONG))
                transfer(pair, whole, 777, rng.choice((200, len(whole))))
            else:
                pair.call(name)
    return records, run


def newest(sectors: bytes, unreadable: bytes) -> dict[RecordKind, bytes]:
    """The newest record of each kind, as the drawing in the loader's README has it: a reader of its own."""
    words = [None if unreadable[at // WORD] else sectors[at : at + WORD] for at in range(0, len(sectors), WORD)]
    each = SECTOR // WORD
    valid = dict[int, int]()
    for sector in range(2):
        head = words[sector * each]
        if head is not None and head[:4] == _HEAD and head[8:12] == struct.pack(">I", zlib.crc32(head[:8])):
            valid[sector] = int.from_bytes(head[4:8], "big")
    if not valid:
        return {}
    # The other one is the later one if it is less than half the numbers ahead.
    in_use = 1 if 0 not in valid or (1 in valid and 0 < (valid[1] - valid[0]) % 2**32 < 2**31) else 0
    log, found, at = words[in_use * each : (in_use + 1) * each], dict[RecordKind, bytes](), 1
    while at < each:
        kind, raw, count = _record(log[at:])
        if kind is not None:
            found[kind] = raw
        at += count
    return found


def _record(words: Sequence[bytes | None]) -> tuple[RecordKind | None, bytes, int]:
    """The record that begins here, and the words that it takes; None and one word if there is none."""
    first = words[0]
    if first is None or first[0] != 0xA5 or first[1] not in list(RecordKind):
        return None, b"", 1
    length = int.from_bytes(first[2:4], "big")
    count = 1 + max(0, -(-(length - 24) // 31))
    rest = words[1:count]
    if length > MAX_RECORD or count > len(words) or any(word is None or word[0] != 0x5A for word in rest):
        return None, b"", 1
    data = (first[8:] + b"".join(word[1:] for word in rest if word))[:length]
    if zlib.crc32(first[1:4] + data) != int.from_bytes(first[4:8], "big"):
        return None, b"", 1
    return RecordKind(first[1]), data, count


def framed(kind: int, raw: bytes) -> bytes:
    head = struct.pack(">BH", kind, len(raw))
    found = b"\xa5" + head + struct.pack(">I", zlib.crc32(head + raw)) + raw[:24].ljust(24, b"\0")
    return found + b"".join(b"\x5a" + raw[at : at + 31].ljust(31, b"\0") for at in range(24, len(raw), 31))


def any_sector(rng: Random, sequence: int) -> bytes:
    """A sector of records in any order, some of them torn, with rests and inventions in between."""
    head = _HEAD + struct.pack(">I", sequence)
    head += struct.pack(">I", zlib.crc32(head) ^ (rng.random() < 0.1))
    found = (head if rng.random() < 0.95 else b"").ljust(WORD, rng.choice((b"\0", b"\xff")))
    for _ in range(rng.randrange(12)):
        kind, raw = any_record(rng)
        tails = 2 * WORD + rng.choice((*9 * [0], -1, 1))
        whole = framed(kind, raw + (rng.randbytes(tails) if kind == RecordKind.STATE else b""))
        match rng.randrange(8):
            case 0:
                cut = WORD * rng.randrange(len(whole) // WORD + 1)
                whole = whole[:cut] + bytes(rng.choice((0, 0, WORD)))
            case 1:
                at = rng.randrange(len(whole))
                whole = whole[:at] + bytes([whole[at] ^ 1 << rng.randrange(8)]) + whole[at + 1 :]
            case 2:
                whole = framed(rng.choice((0, 5, 255)), raw)
            case 3:
                whole = struct.pack(">BBH", 0xA5, rng.randrange(6), rng.choice((0, 25, 8192, 8193, 65535))).ljust(WORD)
            case 4:
                whole = rng.choice((b"\xff" * WORD, rng.randbytes(WORD), b"\x5a" + whole[1:]))
        if len(found) + len(whole) <= SECTOR:
            found += whole
    if rng.random() < 0.2 and len(found) <= SECTOR - 2 * WORD:
        # One that would end behind the sector.
        return found.ljust(SECTOR - WORD, b"\xff") + framed(RecordKind.FAULTS, bytes(30))[:WORD]
    return found.ljust(SECTOR, b"\xff")


def logs(library: Library, seed: str, count: int) -> int:
    """So many logs: C has to find what the reader above finds. How many had a state that is believed."""
    rng, believed = Random(f"logs {seed}"), 0
    pair = Pair(library)
    for _ in range(count):
        sequences = [rng.choice(_SEQUENCES) for _ in range(2)]
        sectors = b"".join(any_sector(rng, sequence) for sequence in sequences)
        unreadable = bytearray(len(sectors) // WORD)
        for _ in range(rng.choice((0, 0, 1, 3))):
            unreadable[rng.choice((0, SECTOR // WORD, rng.randrange(len(unreadable)), rng.randrange(30)))] = 1
        pair.plant_log(sectors, bytes(unreadable), newest(sectors, bytes(unreadable)))
        believed += any(slot.phase != SlotPhase.EMPTY for slot in pair.store.state.slots)
    return believed
