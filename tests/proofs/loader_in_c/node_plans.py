"""What testers ask: sound sequences, odd lengths, failing parts, and everything that can be made of their requests."""

import hashlib
import struct
from collections.abc import Callable, Generator, Sequence
from random import Random
from typing import Any, Final

from can_bridge.flashing.state import Level
from can_bridge.uds.fault_memory import CODES, LENGTHS, FaultReport
from can_bridge.uds.services import MAX_BLOCK, Did, Routine, Service, Session
from contract.controller.calibration import PACKED_BYTES
from tests.can_bridge.flashing.store_ecu import KEY
from tests.proofs.loader_in_c.node_twin import MS, World

Step = bytes | Callable[[Any], None]
"""A request, or what happens to the program that runs."""
Plan = Generator[Step, bytes | None, None]
"""Requests in their order; each is sent the last answer to the one before it."""

_PROGRAMMING: Final = bytes([Service.SESSION, Session.PROGRAMMING])
_EXTENDED: Final = bytes([Service.SESSION, Session.EXTENDED])
_EXIT: Final = bytes([Service.EXIT])
_RESET: Final = bytes([Service.RESET, 1])
_SEED: Final = 2 + 16  # bytes of the answer with it
_BLOCK_LENGTHS: Final = (MAX_BLOCK - 2, MAX_BLOCK - 2, 4000, 3000, 2048)
_LONGEST_NOISE: Final = 64
_HEX: Final = """
10 1000 1004 100100 1082 11 1102 110100 1181 3e 3e01 3e0000 3e80 22 22f1 22ffff 22fd01fd01fd01fd01fd01fd01fd01 27 2700
2701 2701ff 270200 2703 2705 2e 2efd02 2efd0200 2efd1000 2efd12 2ef19100 31 310100 3102ff01 31011234 310102030011
3101ff01 3101ff0000 3101ff00ffffffff 28 2800 280001 280002 280101 280201
"""
_DOWNLOAD_HEX: Final = """
34 3400 340044 34014400000000 34003300000000 34004400000000000000010a 37 3700 36 3601 360100 36020000
"""
_DOWNLOADS: Final = (
    *(bytes.fromhex(text) for text in _DOWNLOAD_HEX.split()),
    *(b"\x36\x01" + bytes(4079), b"\x36\x01" + bytes(4078), b"\x34\x00\x44" + bytes(8)),
)
_ODD: Final = (
    *(bytes.fromhex(text) for text in _HEX.split()),
    *(b"\x22" + 17 * b"\xf1\x86", b"\x22" + 16 * b"\xfd\x01", b"\x31\x01\xff\x00\xff\xff\xff\xff" + bytes(32)),
)
_VALUES: Final = (bytes(4), b"\0\0\0\x80", b"\x17\xb7\x51\x3c", b"\1\0\0\0", b"\0\0\xc0\x7f")


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


def flashing(rng: Random, of: World) -> Plan:
    """The sequence of `stillwake flash`, with any image; it may end before its end."""
    image = rng.choice(list(of.images.values()))
    yield from each(_EXTENDED, routine(Routine.PRECONDITIONS))
    yield from unlocking(Level.PROGRAMMING)
    at = yield from announced(image)
    if at < len(image):
        yield from blocks(image, at, rng.choice(_BLOCK_LENGTHS))
        yield _EXIT
    if rng.random() < 0.9:
        yield routine(Routine.CHECK)
    if rng.random() < 0.2:
        return
    yield from each(routine(Routine.ACTIVATE), _RESET)
    yield from choosing(rng, of)


def choosing(rng: Random, of: World) -> Plan:
    yield from unlocking(Level.PROGRAMMING)
    yield routine(Routine.SELF_TEST)
    yield routine(rng.choice((Routine.CONFIRM, Routine.CONFIRM, Routine.REVERT)))
    yield _RESET


def keys(rng: Random, of: World) -> Plan:
    yield from unlocking(Level.PROGRAMMING)
    lists = of.foreign_lists if rng.random() < 0.5 else of.key_lists
    yield write(Did.KEY_LIST, rng.choice(lists))


def calibrating(rng: Random, of: World) -> Plan:
    yield from unlocking(Level.CALIBRATION)
    yield write(Did.CALIBRATION, rng.randbytes(PACKED_BYTES))
    yield write(Did.CALIBRATION_STORED, bytes([rng.randrange(3)]))


def reading(rng: Random, of: World) -> Plan:
    for _ in range(3):
        dids = rng.choices(list(Did), k=rng.choice((1, 1, 1, 2, 20)))
        yield bytes([Service.READ]) + b"".join(did.to_bytes(2, "big") for did in dids)


def faults(rng: Random, of: World) -> Plan:
    codes = [0xFFFFFF, 0, *CODES.values()]
    for _ in range(6):
        code = rng.choice(codes).to_bytes(3, "big")
        clear, setting = bytes([Service.CLEAR_FAULTS]) + code, bytes([Service.FAULT_SETTING, rng.randrange(4)])
        yield rng.choice((_EXTENDED, clear, setting))
        yield bytes([Service.COMMUNICATION, rng.randrange(3), rng.randrange(4)])
        for report in FaultReport:
            options = {1: bytes([rng.randrange(256)]), 4: code + bytes([rng.choice((1, 0xFF, 2))]), 0: b""}
            yield bytes([Service.REPORT_FAULTS, report]) + options[LENGTHS[report]]


def guessing(rng: Random, of: World) -> Plan:
    """Wrong keys, past a reset, too."""
    level = rng.choice(list(Level))
    for _ in range(rng.choice((1, 2))):
        yield _PROGRAMMING if level is Level.PROGRAMMING else _EXTENDED
        for _ in range(rng.choice((2, 3, 4))):
            answer = yield bytes([Service.SECURITY, level])
            seed = answer[2:] if answer is not None and len(answer) == _SEED else None
            yield _wrong_key(rng, seed)
        yield from each(_PROGRAMMING, _RESET)


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


def each(*steps: Step) -> Plan:
    """These, whatever is answered."""
    for step in steps:  # noqa: UP028  (answers are sent here, too)
        yield step


def any_of(rng: Random, of: World) -> Plan:
    sound = (*5 * [flashing], choosing, keys, calibrating, reading, guessing, *3 * [faults])
    own = (edges, transfers, calibrations, controlled, failing, lambda rng, of: story(rng, of, 9))
    return rng.choice(sound if rng.random() < 0.5 else own)(rng, of)


def story(rng: Random, of: World, steps: int) -> Plan:
    """A sound image, up to so many steps behind its transfer: check, activate, reset, test, confirm twice, revert."""
    image = of.images[rng.choice(("newest", "newest", "for this hardware", "one", "again", "second"))]
    yield from unlocking(Level.PROGRAMMING)
    if rng.random() < 0.3:
        yield from each(*(2 * [write(Did.KEY_LIST, rng.choice(of.key_lists[:3]))]))
    at = yield from announced(image)
    for number, start in enumerate(range(at, len(image), 4078), start=1):
        yield bytes([0x36, number]) + image[start : start + 4078]
        if rng.random() < 0.05:
            yield lambda program: program.twins.fail(1)
        elif rng.random() < 0.3:
            yield bytes([0x36, number]) + image[start : start + rng.choice((4078, 4078, 100))]
    yield lambda program: program.twins.fail(0)
    yield rng.choice((b"\x37", b"\x36\x03!"))
    yield b"\x37"
    wanted = (rng.choice((routine(Routine.CHECK), b"\x31\x81\xff\x01")), routine(Routine.ACTIVATE), b"\x11\x01")
    if rng.random() < 0.3:
        # Others come amid the work, more than there is room for.
        report = 3 * b"\xfd\x01"
        yield lambda program: program.burst(wanted[0], b"\x3e\x80", b"\x3e\x00", b"\x3e", b"\x11\x01", b"\x3f\x80")
        yield lambda program: program.wait(30 * MS)
        yield lambda program: program.burst(*(rng.choice((1, 10)) * [b"\x22" + report]))
    yield from each(*wanted[:steps])
    if steps > len(wanted):
        yield from unlocking(Level.PROGRAMMING)
        fails = rng.choice((0, 0, 4, 5, 6))
        yield lambda program: program.twins.fail(fails)
        yield routine(Routine.SELF_TEST)
        yield lambda program: program.twins.fail(0)
        if rng.random() < 0.2:
            # The image that runs on trial is written over.
            yield routine(Routine.ERASE, len(image).to_bytes(4, "big") + bytes(32))
            yield from each(routine(Routine.SELF_TEST), lambda program: program.control(3, False))
        yield from each(*2 * [routine(Routine.CONFIRM)])
        if rng.random() < 0.4:
            yield routine(Routine.REVERT)
        yield b"\x11\x01"


def flashed(of: World, name: str) -> Plan:
    image = of.images[name]
    yield from unlocking(Level.PROGRAMMING)
    yield from blocks(image, (yield from announced(image)), 400)
    yield from each(b"\x37", routine(Routine.CHECK), routine(Routine.ACTIVATE))


def overtaken(of: World) -> Plan:
    """A release that may run no more once a newer one is confirmed: nothing leads back to it."""
    for name in ("one", "newest"):
        yield from flashed(of, name)
        yield b"\x11\x01"
        yield from unlocking(Level.PROGRAMMING)
        yield from each(routine(Routine.SELF_TEST), routine(Routine.CONFIRM), routine(Routine.REVERT))


def confirmations(of: World) -> Plan:
    """A first release on trial, with what must come before its confirmation, and what takes that away."""
    confirm, test = routine(Routine.CONFIRM), routine(Routine.SELF_TEST)
    yield from flashed(of, "newest")
    yield from each(test, confirm, b"\x11\x01")
    yield from unlocking(Level.PROGRAMMING)
    yield from each(confirm, test, lambda program: program.twins.fail(4), test, lambda program: program.twins.fail(0))
    yield from each(confirm, test, routine(Routine.ERASE, b"\0\0\x10\0" + bytes(32)), confirm, test, confirm, confirm)


def edges(rng: Random, of: World) -> Plan:
    yield from rng.choice((unlocking(Level.PROGRAMMING), unlocking(Level.CALIBRATION), each(b"\x10\x01")))
    yield from each(*rng.choices(_ODD + _DOWNLOADS, k=12))


def transfers(rng: Random, of: World) -> Plan:
    """A download that is asked for in every wrong way."""
    image = of.images["one"]
    head, length = b"\x34\x00\x44", len(image).to_bytes(4, "big")
    first, last = b"\x36\x01" + image[:4078], b"\x36\x02" + image[4078:]
    yield from unlocking(Level.PROGRAMMING)
    yield routine(Routine.ERASE, length + bytes(31) + rng.randbytes(1))
    yield from each(head + bytes(3) + b"\1" + length, head + bytes(4) + bytes(4), head + bytes(4) + length)
    yield from each(head + bytes(4) + length, head + bytes(4) + bytes(4), head + b"\0\0\0\1" + length)
    yield first
    if rng.random() < 0.3:
        yield routine(Routine.ERASE, length + bytes(31) + rng.randbytes(1))
    yield from each(*rng.choices((first, b"\x36\x02" + bytes(4000), b"\x36\x03a", b"\x37"), k=4))
    yield last
    yield from each(*rng.choices((*_DOWNLOADS, b"\x36\x03a", last, b"\x37", head + bytes(8)), k=5))


def calibrations(rng: Random, of: World) -> Plan:
    """Values that are allowed, stored and taken back; read in between."""
    yield from unlocking(Level.CALIBRATION)
    answer = yield b"\x22\xfd\x11"
    own = bytes(answer[3 + 2 * PACKED_BYTES :]) if answer is not None and answer[0] == 0x62 else bytes(PACKED_BYTES)
    for _ in range(4):
        values = bytearray(own)
        most = PACKED_BYTES // 4
        at = 4 * rng.choice((rng.randrange(most), most - 2, most - 3))
        half = struct.pack("<f", 0.5 * struct.unpack_from("<f", own, at)[0])
        values[at : at + 4] = rng.choice((own[at : at + 4], half, *_VALUES))
        yield write(Did.CALIBRATION, bytes(values))
        yield lambda program: program.control(1, False)
        yield write(Did.CALIBRATION_STORED, bytes([rng.choice((0, 1, 1, 2))]))
        yield b"\x22\xfd\x10\xfd\x12"
    if rng.random() < 0.5:
        yield from unlocking(Level.PROGRAMMING)
        yield b"\x11\x01"


def controlled(rng: Random, of: World) -> Plan:
    """The jets run, or could, while a tester asks for what may not be then."""
    erase = routine(Routine.ERASE, b"\0\0\x10\0" + bytes(32))
    yield from unlocking(Level.CALIBRATION)
    yield from each(write(Did.CALIBRATION_STORED, b"\1"), rng.choice((b"\x3e\0", b"\x28\1\1")))
    yield lambda program: program.control(12, False)
    yield lambda program: program.control(rng.choice((1, 30)), True)
    yield from each(b"\x10\x02", routine(Routine.PRECONDITIONS), write(Did.CALIBRATION_STORED, b"\1"), b"\x28\x01\x01")
    yield write(Did.CALIBRATION_STORED, b"\0")
    yield from unlocking(Level.PROGRAMMING)
    yield from each(erase, b"\x11\x01", lambda program: program.control(60, None))
    yield from unlocking(Level.PROGRAMMING)
    yield from each(lambda program: program.control(14, False), lambda program: program.control(14, True))
    yield from each(erase, routine(Routine.REVERT))
    yield from each(*(write(Did.KEY_LIST, one) for one in of.key_lists), b"\x11\x01", b"\x10\x02", b"\x10\x01")
    yield lambda program: program.control(60, None)


def failing(rng: Random, of: World) -> Plan:
    """The memory takes nothing for a while, or the source of random bytes gives zeros, or none; and wrong keys."""
    level = rng.choice(list(Level))
    yield from rng.choice((unlocking(level), each(b"\x10\x02")))
    fails = rng.choice((1, 2, 3))
    unlocks = (bytes([0x27, level]), bytes([0x27, level + 1]) + bytes(16))
    yield from each(lambda program: program.twins.fail(fails), *unlocks)
    yield from each(routine(Routine.ACTIVATE), write(Did.CALIBRATION_STORED, b"\1"))
    yield from each(b"\x36\x01a", routine(Routine.CONFIRM))
    yield lambda program: program.twins.fail(0)
    for _ in range(rng.choice((0, 0, 0, 4, 260))):
        yield lambda program: program.wait(rng.choice((1, 10_000, 10_001)) * MS)
        yield from each(bytes([0x10, 2 if level is Level.PROGRAMMING else 3]), *unlocks)
