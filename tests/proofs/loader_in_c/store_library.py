"""The store in C as a shared library, over a flash memory that is played, bound through cffi."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import cffi
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.release import controller_image, signing
from contract.release.checks import dbc_sha256
from contract.release.controller_image import HEADER, VEHICLE, ImageFacts, seal
from export.to_c.loader_files import loader_sources
from firmware_sim.in_c.compiler import compile_c, host_compiler
from tests.can_bridge.flashing.releases import RELEASE, ROOT, SECOND, STRANGER

SECTOR: Final = 8192
SLOT_SECTORS: Final = 2
SLOT_BYTES: Final = SLOT_SECTORS * SECTOR
WORD: Final = 32
GEOMETRY: Final = (f"-DSW_FLASH_SECTOR={SECTOR}u", f"-DSW_SLOT_SECTORS={SLOT_SECTORS}u")
NEVER: Final = 2**64 - 1
HARDWARE: Final = "bench"
TWIN: Final = "store_twin.c"
OWN: Final = (
    "sw_boot.c", "sw_judge.c", "sw_keys.c", "sw_records.c", "sw_release.c", "sw_remembered.c", "sw_sha256.c",
    "sw_sha512.c", "sw_signature.c", "sw_slots.c", "sw_state.c", "sw_store.c", "sw_store_report.c",
)  # fmt: skip
_DECLARED: Final = """
uint32_t twin_bytes(void);
void twin_erased(void *, const uint8_t *);
void twin_power_on(void *, uint64_t, uint64_t);
void twin_wear(void *, uint64_t);
void *twin_store(void *);
const uint8_t *twin_memory(void *);
const uint8_t *twin_unreadable(void *);
uint64_t twin_operations(void *);
uint32_t twin_twice(void *);
uint8_t twin_is_off(void *);
uint32_t twin_wanted(void *);
uint8_t twin_verdict(void *);
const uint8_t *twin_tail(void *, uint32_t);
uint32_t twin_record(void *, uint32_t, uint8_t *);
uint32_t twin_judge(const uint8_t *, uint32_t, const uint8_t *, uint32_t, const uint8_t *, uint32_t);
uint32_t twin_keys_version(const uint8_t *, uint32_t, const uint8_t *);
void twin_sha256(const uint8_t *, uint32_t, uint32_t, uint8_t *);
int sw_signature_is_good(const uint8_t *, const uint8_t *, const uint8_t *, uint32_t);
void sw_store_boot(void *);
const uint8_t *sw_store_image(void *);
int sw_store_announce(void *, uint32_t, const uint8_t *);
int sw_store_append(void *, const uint8_t *, uint32_t);
int sw_store_finish(void *);
int sw_store_go_on(void *);
void sw_store_drop(void *);
int sw_store_activate(void *);
int sw_store_confirm(void *);
int sw_store_revert(void *);
int sw_store_take_keys(void *, const uint8_t *, uint32_t);
int sw_store_keep_calibration(void *, const uint8_t *, uint32_t);
uint32_t sw_store_calibration(void *, uint8_t *);
uint8_t sw_store_failed_attempts(void *, uint8_t);
int sw_store_keep_failed_attempts(void *, uint8_t, uint32_t);
uint32_t sw_store_faults(void *, uint8_t *, uint32_t);
int sw_store_keep_faults(void *, const uint8_t *, uint32_t);
uint32_t sw_store_report(void *, uint8_t *);
uint32_t sw_store_received(void *);
"""

LAYOUT: Final = hashlib.sha256(b"layout").digest()
FACTS: Final = ImageFacts(
    layout=LAYOUT, dbc=bytes.fromhex(dbc_sha256()), digest=hashlib.sha256(b"one").digest(), security_version=1,
    period_ns=200_000_000, operating_point=(2.6, 25.0, 1.2), action_limit=0.1, sensors=12, hardware=HARDWARE,
    name="one",
)  # fmt: skip


def sources() -> dict[str, bytes]:
    """The store's files, and the flash memory that it stands in."""
    found = {name: content for name, content in loader_sources().items() if name.endswith(".h") or name in OWN}
    return found | {TWIN: Path(__file__).with_name("c").joinpath(TWIN).read_bytes()}


def image(name: str, length: int = 900, *, key: Ed25519PrivateKey | None = RELEASE, **changes: Any) -> bytes:
    """A small release, with its name's hash for its digest."""
    digest = hashlib.sha256(name.encode()).digest()
    payload = (digest * (length // 32 + 1))[:length]
    return seal(payload, replace(FACTS, **{"name": name, "digest": digest, **changes}), key)


def resigned(whole: bytes, at: int, value: bytes, key: Ed25519PrivateKey = RELEASE) -> bytes:
    """An image with other bytes in its header, signed again."""
    header = bytearray(whole[:HEADER])
    header[at : at + len(value)] = value
    header[416:448] = signing.public_key(key).raw
    return bytes(header[:448]) + key.sign(bytes(header[:448])) + whole[HEADER:]


def rules(like: bytes) -> bytes:
    """The `sw_rules` of an ECU for which this image was made."""
    hardware = HARDWARE.encode().ljust(64, b"\0")
    return signing.public_key(ROOT).raw + LAYOUT + FACTS.dbc + hardware + like[VEHICLE]


ONE: Final = image("one")
GOOD: Final = {"one": ONE, "two": image("two", 2500, security_version=2), "three": image("three", 64, key=SECOND)}
LONG: Final = image("long", 2 * SLOT_BYTES // 3)
"""It needs both sectors of a slot."""
WRONG: Final = {
    "unsigned": image("x", key=None), "stranger": image("x", key=STRANGER), "signature": ONE[:500] + b"\1" + ONE[501:],
    "dbc": image("x", dbc=bytes(32)), "build": image("x", layout=bytes(32)), "hardware": image("x", hardware="other"),
    "period": image("x", period_ns=1), "vehicle": image("x", sensors=11), "limit": image("x", action_limit=0.2),
    "payload": ONE[:-1] + b"\0", "old": image("x", security_version=0), "any": image("any", hardware=None),
    "short": ONE[:100], "length": ONE + b"\0", "magic": b"X" + ONE[1:], "header": resigned(ONE, 12, b"\1"),
    "reserved": resigned(ONE, 330, b"\1"), "name": resigned(ONE, 256, b"\0"), "control": resigned(ONE, 256, b"\x1b"),
    "gap": resigned(ONE, 257, b"\0"), "DEL": resigned(ONE, 258, b"\x7f"), "hardware gap": resigned(ONE, 193, b"\0"),
    "hardware zeros": resigned(ONE, 192, b"\0"), "full": resigned(ONE, 256, b"n" * 64), "sha": resigned(ONE, 16, b"\0"),
}  # fmt: skip
assert controller_image.read(ONE).facts == FACTS


class Library:
    """One library, compiled and loaded; raises LibraryError where the compiler does not take the files."""

    def __init__(
        self, output: Path, contents: Mapping[str, bytes] | None = None, flags: Sequence[str] = ("-O1",)
    ) -> None:
        compile_c(
            sources() if contents is None else contents, output, compiler=host_compiler(),
            flags=(*flags, *GEOMETRY, "-shared", "-fPIC"),
        )  # fmt: skip
        self._load(output)

    @classmethod
    def loaded(cls, output: Path) -> "Library":
        """One that is compiled already."""
        made = cls.__new__(cls)
        made._load(output)
        return made

    def _load(self, output: Path) -> None:
        self.ffi: Any = cffi.FFI()
        self.ffi.cdef(_DECLARED)
        self.c = self.ffi.dlopen(str(output))

    def judge(self, found: bytes, keys: bytes, least: int = 1) -> int:
        """The verdict on an image by itself."""
        return int(self.c.twin_judge(found, len(found), keys, len(keys), rules(ONE), least))
