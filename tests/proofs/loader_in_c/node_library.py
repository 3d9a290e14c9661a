"""The node in C, with diagnosis and store, as a shared library: its networks and the layout of an image are stubs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from can_bridge.wire.frame import Frame
from contract.config.tree import Config
from contract.release.checks import Bundle
from export.to_c.loader_files import loader_sources
from firmware_sim.in_c.c_structs import Structs
from firmware_sim.in_c.compiler import compile_c, host_compiler
from firmware_sim.in_c.uds_settings import HEADER, uds_settings
from tests.proofs.ecu_in_c import library

GEOMETRY: Final = ("-DSW_FLASH_SECTOR=16384u", "-DSW_SLOT_SECTORS=3u")
"""A small flash memory, so that its sectors are often full."""
SLOT_BYTES: Final = 3 * 16384
FLAGS: Final = (*library.EXACT, *GEOMETRY)
_STUBS: Final = ("node_host.c", "node_host.h", "sw_image.h")
_DECLARED: Final = """
size_t host_bytes(void);
void host_init(void *, const uint8_t *, const uint8_t *, const char *, const char *, const char *);
void host_power_on(void *);
int host_provision(void *, const uint8_t *, uint32_t, const uint8_t *, uint32_t, const uint8_t *);
int host_control(void *, int64_t, const sw_frame *, int, sw_frame *);
int host_service(void *, int64_t, const sw_frame *, int, sw_frame *);
uint32_t host_fact(const void *, int);
void host_break(void *, int);
void sw_aes_cmac(const uint8_t *, const uint8_t *, uint32_t, uint8_t *);
void sw_aes_encrypt(const uint8_t *, uint8_t *);
"""
BUSY, WANTS_RESET, NEEDS_RESET, SESSION, UNLOCKED, REASON, RUNNING, WORST_WRITES = range(8)
"""What `Host.fact` can be asked."""


def sources(config: Config) -> dict[str, bytes]:
    """All files of the library for one vehicle."""
    own = Path(__file__).with_name("c")
    ecu = library.sources(config)
    left_out = {"twin.c", "twin.h", "sw_image.c", "sw_own_ecu.c", "sw_own_layout.c"}
    return {name: content for name, content in ecu.items() if name not in left_out} | {
        **loader_sources(),
        **{name: own.joinpath(name).read_bytes() for name in _STUBS},
        HEADER: uds_settings(),
    }


class Library:
    """A compiled and loaded library."""

    def __init__(self, contents: Mapping[str, bytes], output: Path, flags: Sequence[str] = FLAGS) -> None:
        compile_c(contents, output, compiler=host_compiler(), flags=(*flags, "-shared", "-fPIC"))
        self.structs = Structs(contents, host_compiler())
        self.ffi = self.structs.ffi
        self.ffi.cdef(_DECLARED)
        self.c = self.ffi.dlopen(str(output))

    def payload(self, bundle: Bundle, length: int) -> bytes:
        """A release's numbers as the stub reads them, and other bytes."""
        release = self.ffi.new("sw_release *")
        release.weights = list(bundle.manifest.mpc.weights.as_tuple())
        release.bundle_hash = bundle.short_hash
        raw = bytes(self.ffi.buffer(release))
        return raw + bytes(i % 251 for i in range(length - len(raw)))


class Host:
    """A node with a flash memory.

    Args:
        rules: as `sw_rules` has them.
        texts: hardware, serial number, software.
    """

    def __init__(self, of: Library, rules: bytes, access_key: bytes, texts: Sequence[str]) -> None:
        self._lib, self._ffi, self._structs = of.c, of.ffi, of.structs
        self._room = self._ffi.new("int64_t[]", self._lib.host_bytes() // 8 + 1)
        self._sent = self._ffi.new("sw_frame[]", 10)
        self._lib.host_init(self._room, rules, access_key, *(text.encode() for text in texts))

    def provision(self, keys: bytes, image: bytes, sha256: bytes) -> None:
        """A key list, and a release that is confirmed; without one if it is empty."""
        assert self._lib.host_provision(self._room, keys, len(keys), image, len(image), sha256) == 0

    def power_on(self) -> None:
        self._lib.host_power_on(self._room)

    def fact(self, which: int) -> int:
        return int(self._lib.host_fact(self._room, which))

    def break_memory(self, broken: bool) -> None:
        self._lib.host_break(self._room, broken)

    def control(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        return self._call(self._lib.host_control, now_ns, frames)

    def service(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        return self._call(self._lib.host_service, now_ns, frames)

    def _call(self, function: Any, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        count = function(self._room, now_ns, self._structs.frames(frames), len(frames), self._sent)
        return [self._structs.frame(self._sent[i]) for i in range(count)]
