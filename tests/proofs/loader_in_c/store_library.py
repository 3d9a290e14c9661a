"""The store in C as a shared library, over a flash memory that is played, bound through cffi."""

import hashlib
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import cffi
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.flashing import checking
from contract.release import controller_image, signing
from contract.release.checks import dbc_sha256
from contract.release.controller_image import HEADER_BYTES, VEHICLE, ImageFacts, seal
from ecu.c.sources import loader_sources
from tests.can_bridge.flashing.releases import RELEASE, ROOT, SECOND, STRANGER

SECTOR: Final = 8192
SLOT_BYTES: Final = 2 * SECTOR
WORD: Final = 32
GEOMETRY: Final = (f"-DSW_FLASH_SECTOR={SECTOR}u", "-DSW_SLOT_SECTORS=2u")
FLAGS: Final = ("-O1", *GEOMETRY)
NEVER: Final = 2**64 - 1
HARDWARE: Final = "bench"
TWIN: Final = "store_twin.c"
MEASURED: Final = (
    "sw_hashes.c", "sw_records.c", "sw_release.c", "sw_signature.c", "sw_store.c", "sw_store_judge.c",
    "sw_store_kept.c",
)  # fmt: skip
_BOUND: Final = (TWIN, "sw_store.h", "sw_records.h", "sw_release.h", "sw_crypto.h")
_FUNCTION: Final = re.compile(
    r"^(?!static|typedef)\w[\w ]*?\*?(?:twin|sw_store|sw_records|sw_signature)_\w+\([^)]*\)", re.MULTILINE
)
_STRUCTURE: Final = re.compile(
    r"(?:const )?(?:twin|sw_store|sw_records|sw_part|sw_flash|sw_rules) (?=\*)"
    r"|sw_(store_result|record_kind|flash_state)(?= )"
)

LAYOUT: Final = hashlib.sha256(b"layout").digest()
FACTS: Final = ImageFacts(
    layout=LAYOUT, dbc=bytes.fromhex(dbc_sha256()), digest=hashlib.sha256(b"one").digest(), security_version=1,
    period_ns=200_000_000, operating_point=(2.6, 25.0, 1.2), action_limit=0.1, sensors=12, hardware=HARDWARE,
    name="one",
)  # fmt: skip


def sources() -> dict[str, bytes]:
    found = {name: content for name, content in loader_sources().items() if name.endswith(".h") or name in MEASURED}
    return found | {TWIN: Path(__file__).with_name("c").joinpath(TWIN).read_bytes()}


def image(
    name: str, length: int = 900, *, key: Ed25519PrivateKey | None = RELEASE, first: bytes = b"", **changes: Any
) -> bytes:
    """A small release, with its name's hash for its digest."""
    digest = hashlib.sha256(name.encode()).digest()
    payload = first + (digest * (length // 32 + 1))[len(first) : length]
    return seal(payload, replace(FACTS, **{"name": name, "digest": digest, **changes}), key)


def resigned(whole: bytes, at: int, value: bytes, key: Ed25519PrivateKey = RELEASE) -> bytes:
    """An image with other bytes in its header, signed again."""
    header = bytearray(whole[:HEADER_BYTES])
    header[at : at + len(value)] = value
    header[416:448] = signing.public_key(key).raw
    return bytes(header[:448]) + key.sign(bytes(header[:448])) + whole[HEADER_BYTES:]


def rules(like: bytes) -> bytes:
    """The `sw_rules` of an ECU for which this image was made."""
    hardware = HARDWARE.encode().ljust(64, b"\0")
    return signing.public_key(ROOT).raw + LAYOUT + FACTS.dbc + hardware + like[VEHICLE]


judged: Final = partial(checking.judge_image, layout=LAYOUT, opens=lambda payload: payload[:1] != b"\xff")
"""The verdict on an image in Python, and its facts. The stubs of `sw_image_open` open the same payloads."""
ONE: Final = image("one")
GOOD: Final = {"one": ONE, "two": image("two", 2500, security_version=2), "three": image("three", 64, key=SECOND)}
LONG: Final = image("long", 2 * SLOT_BYTES // 3)  # it needs both sectors of a slot
WRONG: Final = {
    "unsigned": image("x", key=None), "stranger": image("x", key=STRANGER), "signature": ONE[:500] + b"\1" + ONE[501:],
    "dbc": image("x", dbc=bytes(32)), "build": image("x", layout=bytes(32)), "hardware": image("x", hardware="other"),
    "period": image("x", period_ns=1), "vehicle": image("x", sensors=11), "limit": image("x", action_limit=0.2),
    "payload": ONE[:-1] + b"\0", "old": image("x", security_version=0), "any": image("any", hardware=None),
    "short": ONE[:100], "length": ONE + b"\0", "magic": b"X" + ONE[1:], "header": resigned(ONE, 12, b"\1"),
    "reserved": resigned(ONE, 330, b"\1"), "name": resigned(ONE, 256, b"\0"), "control": resigned(ONE, 256, b"\x1b"),
    "gap": resigned(ONE, 257, b"\0"), "DEL": resigned(ONE, 258, b"\x7f"), "hardware gap": resigned(ONE, 193, b"\0"),
    "hardware zeros": resigned(ONE, 192, b"\0"), "full": resigned(ONE, 256, b"n" * 64), "sha": resigned(ONE, 16, b"\0"),
    "closed": image("x", first=b"\xff"), "closed and old": image("x", first=b"\xff", security_version=0),
    "no point": ONE[:416] + b"\2" + bytes(31) + ONE[448:],
}  # fmt: skip
assert controller_image.read(ONE).facts == FACTS
RUNNABLE: Final = frozenset({*GOOD.values(), LONG, WRONG["any"], WRONG["full"]})
RULES: Final = rules(ONE)
SETTINGS: Final[dict[str, Any]] = {
    "root": signing.public_key(ROOT), "hardware": HARDWARE, "fits": checking.fits_as(ONE), "check": judged,
}  # fmt: skip
"""Of the Python store, as `RULES` are of the one in C."""


class Library:
    """One that was built, loaded; its functions are those of the sources, with nameless structures."""

    def __init__(self, path: Path) -> None:
        text = b"".join(content for name, content in sources().items() if name in _BOUND)
        self.ffi: Any = cffi.FFI()
        self.ffi.cdef("typedef void *sw_store_opens;")
        for found in _FUNCTION.findall(text.decode()):
            self.ffi.cdef(_STRUCTURE.sub(lambda match: "int" if match[1] else "void ", found) + ";")
        self.c = self.ffi.dlopen(str(path))

    def judge(self, found: bytes, keys: bytes) -> int:
        return int(self.c.twin_judge(found, len(found), keys, len(keys), RULES, 1))
