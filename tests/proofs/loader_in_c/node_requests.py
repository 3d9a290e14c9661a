"""What a hostile or clumsy tester sends: sound sequences, and everything that can be made of their requests."""

import hashlib
from collections.abc import Generator, Sequence
from random import Random
from typing import Final

from can_bridge.flashing.access_level import Level
from can_bridge.uds.fault_codes import CODES
from can_bridge.uds.fault_memory import LENGTHS, FaultReport
from can_bridge.uds.services import MAX_BLOCK, Did, Routine, Service, Session
from contract.controller.calibration import PACKED_BYTES
from tests.can_bridge.flashing.store_ecu import KEY
from tests.proofs.loader_in_c.node_twin import World

Plan = Generator[bytes, bytes | None, None]
"""Requests in their order; each is sent the last answer to the one before it."""

_PROGRAMMING: Final = bytes([Service.SESSION, Session.PROGRAMMING])
_EXTENDED: Final = bytes([Service.SESSION, Session.EXTENDED])
_EXIT: Final = bytes([Service.EXIT])
_RESET: Final = bytes([Service.RESET, 1])
_SEED: Final = 2 + 16
"""Bytes of the answer with a seed."""
_BLOCK_LENGTHS: Final = (MAX_BLOCK - 2, MAX_BLOCK - 2, 4000, 3000, 2048)
_LONGEST_NOISE: Final = 64


def routine(number: Routine, option: bytes = b"") -> bytes:
    return bytes([Service.ROUTINE, 1]) + number.to_bytes(2, "big") + option


def write(did: Did, content: bytes) -> bytes:
    return bytes([Service.WRITE]) + did.to_bytes(2, "big") + content


def announced(image: bytes) -> Generator[bytes, bytes | None, int]:
    """The announcement of an image, and the request for what is missing; returns the offset of that."""
    answer = yield routine(Routine.ERASE, len(image).to_bytes(4, "big") + hashlib.sha256(image).digest())
    at = int.from_bytes(answer[4:8], "big") if answer is not None and answer[0] == 0x71 else 0
    if at < len(image):
        yield bytes([Service.DOWNLOAD, 0x00, 0x44]) + at.to_bytes(4, "big") + (len(image) - at).to_bytes(4, "big")
    return at


def blocks(image: bytes, at: int, size: int, most: int = 1 << 16) -> Plan:
    """So many blocks of an image from an offset on."""
    for number, start in enumerate(range(at, len(image), size)[:most], start=1):
        yield bytes([Service.TRANSFER, number % 256]) + image[start : start + size]


def any_plan(rng: Random, of: World) -> Plan:
    """What a tester may want."""
    return rng.choice((*5 * [flashing], choosing, keys, calibrating, reading, guessing, *3 * [faults]))(rng, of)


def flashing(rng: Random, of: World) -> Plan:
    """The sequence of `stillwake flash`, with any image; it may end before its end."""
    image = rng.choice(list(of.pool.images.values()))
    yield _EXTENDED
    yield routine(Routine.PRECONDITIONS)
    yield from unlocking(Level.PROGRAMMING)
    at = yield from announced(image)
    if at < len(image):
        yield from blocks(image, at, rng.choice(_BLOCK_LENGTHS))
        yield _EXIT
    if rng.random() < 0.9:
        yield routine(Routine.CHECK)
    if rng.random() < 0.2:
        return
    yield routine(Routine.ACTIVATE)
    yield _RESET
    yield from choosing(rng, of)


def choosing(rng: Random, of: World) -> Plan:
    yield from unlocking(Level.PROGRAMMING)
    yield routine(Routine.SELF_TEST)
    yield routine(rng.choice((Routine.CONFIRM, Routine.CONFIRM, Routine.REVERT)))
    yield _RESET


def keys(rng: Random, of: World) -> Plan:
    yield from unlocking(Level.PROGRAMMING)
    lists = of.pool.foreign_lists if rng.random() < 0.5 else of.pool.key_lists
    yield write(Did.KEY_LIST, rng.choice(lists))


def calibrating(rng: Random, of: World) -> Plan:
    """Values, sound or not."""
    yield from unlocking(Level.CALIBRATION)
    yield write(Did.CALIBRATION, rng.randbytes(PACKED_BYTES))
    yield write(Did.CALIBRATION_STORED, bytes([rng.randrange(3)]))


def reading(rng: Random, of: World) -> Plan:
    """Identifiers, one by one or several."""
    for _ in range(3):
        dids = rng.choices(list(Did), k=rng.choice((1, 1, 1, 2, 20)))
        yield bytes([Service.READ]) + b"".join(did.to_bytes(2, "big") for did in dids)


def faults(rng: Random, of: World) -> Plan:
    """The fault memory, its switch, and silence on the bus."""
    codes = [0xFFFFFF, 0, *CODES.values()]
    for _ in range(6):
        code = rng.choice(codes).to_bytes(3, "big")
        yield rng.choice(
            (_EXTENDED, bytes([Service.CLEAR_FAULTS]) + code, bytes([Service.FAULT_SETTING, rng.randrange(4)]))
        )
        yield bytes([Service.COMMUNICATION, rng.randrange(3), rng.randrange(4)])
        for report in FaultReport:
            option = {1: bytes([rng.randrange(256)]), 4: code + bytes([rng.choice((1, 0xFF, 2))]), 0: b""}[
                LENGTHS[report]
            ]
            yield bytes([Service.REPORT_FAULTS, report]) + option


def guessing(rng: Random, of: World) -> Plan:
    """Wrong keys, past a reset, too."""
    level = rng.choice(list(Level))
    for _ in range(rng.choice((1, 2))):
        yield _PROGRAMMING if level is Level.PROGRAMMING else _EXTENDED
        for _ in range(rng.choice((2, 3, 4))):
            answer = yield bytes([Service.SECURITY, level])
            seed = answer[2:] if answer is not None and len(answer) == _SEED else None
            yield _wrong_key(rng, seed)
        yield _PROGRAMMING
        yield _RESET


def any_noise(rng: Random, sent: Sequence[bytes], seed: bytes | None) -> bytes:
    """A request that is in no plan, made from requests before it and the seed that the ECU gave last."""
    kind = rng.choice(("random", "service", "damaged", "damaged", "again", "again", "wrong key", "routine"))
    if kind == "random":
        return rng.randbytes(rng.randrange(_LONGEST_NOISE))
    if kind == "again":
        return sent[-1] if rng.random() < 0.5 else rng.choice(sent)
    if kind == "routine":
        return routine(rng.choice(list(Routine)), rng.choice((b"", b"", rng.randbytes(36))))
    if kind == "service":
        second = rng.choice((0, 1, 2, 3, 4, 0x81, 0x82, 0x83, rng.randrange(256)))
        length = rng.choice((0, 0, 1, 2, 9, 16, 36, rng.randrange(_LONGEST_NOISE)))
        return bytes([rng.choice(list(Service)), second]) + rng.randbytes(length)
    return _wrong_key(rng, seed) if kind == "wrong key" else _damaged(rng, sent)


def unlocking(level: Level) -> Plan:
    """Into the level's session, with the right key."""
    yield _PROGRAMMING if level is Level.PROGRAMMING else _EXTENDED
    answer = yield bytes([Service.SECURITY, level])
    if answer is not None and len(answer) == _SEED and any(answer[2:]):
        yield bytes([Service.SECURITY, level + 1]) + KEY.answer(level, answer[2:])


def _damaged(rng: Random, sent: Sequence[bytes]) -> bytes:
    raw = bytearray(rng.choice(sent))
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        kind = rng.randrange(5)
        if kind == 0 and raw:
            raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
        elif kind == 1 and raw:
            # The first bytes are what makes a request one.
            raw[rng.randrange(min(4, len(raw)))] = rng.randrange(256)
        elif kind == 2:
            del raw[rng.randrange(len(raw) + 1) :]
        elif kind == 3:
            raw += rng.randbytes(rng.randrange(1, 8))
        elif raw:
            at = rng.randrange(len(raw))
            raw[at:at] = raw[:at][-8:]
    return bytes(raw)


def _wrong_key(rng: Random, seed: bytes | None) -> bytes:
    """Zeros, the seed, the other level's, one bit wrong, or an old one."""
    level = rng.choice(list(Level))
    seed = bytes(16) if seed is None else seed
    right = KEY.answer(level, seed)
    other = KEY.answer(Level.PROGRAMMING if level is Level.CALIBRATION else Level.CALIBRATION, seed)
    flipped = bytes([right[0] ^ 1 << rng.randrange(8)]) + right[1:]
    guess = rng.choice((bytes(16), b"\xff" * 16, seed, other, flipped, rng.randbytes(16), KEY.answer(level, bytes(16))))
    return bytes([Service.SECURITY, level + 1]) + guess
