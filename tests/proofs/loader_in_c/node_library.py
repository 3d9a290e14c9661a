"""The node in C, with diagnosis and store, as a shared library: its networks and the layout of an image are stubs."""

import hashlib
import re
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from can_bridge.wire.frame import Frame
from contract.config.tree import Config
from contract.release.checks import Bundle
from ecu.c.sources import loader_sources
from ecu.in_c import compiler
from ecu.in_c.c_structs import Structs
from ecu.in_c.uds_settings import UDS_SETTINGS, uds_settings
from tests.can_bridge.flashing.releases import keys
from tests.can_bridge.flashing.store_ecu import SECRET
from tests.proofs.ecu_in_c import library

GEOMETRY: Final = ("-ffp-contract=off", "-DSW_FLASH_SECTOR=16384u", "-DSW_SLOT_SECTORS=3u")
"""A small flash memory, so that its sectors are often full."""
SLOT_BYTES: Final = 3 * 16384
QUICK: Final = ("-O0", *GEOMETRY)
_FUZZ: Final = "node_fuzz.c"  # a program of its own, and no part of the library
_STUBS: Final = ("node_host.c", "node_host.h", _FUZZ, "sw_image.h")
_OTHERS: Final = ("twin.c", "twin.h", "sw_image.c", "sw_own_ecu.c")
_DECLARED: Final = re.compile(r"^[\w ]+ \*?host_\w+\([^)]*\);", re.MULTILINE)
BUSY, WANTS_RESET, NEEDS_RESET, SESSION, UNLOCKED, REASON, RUNNING, WORST_WRITES, WAITS, DRIVES_JETS, WRITES = range(11)
"""What `Host.fact` can be asked."""


def sources(config: Config) -> dict[str, bytes]:
    own = Path(__file__).with_name("c")
    ecu = library.sources(config)
    return {name: content for name, content in ecu.items() if name not in _OTHERS} | {
        **loader_sources(),
        **{name: own.joinpath(name).read_bytes() for name in _STUBS},
        UDS_SETTINGS: uds_settings(),
    }


def build(contents: Mapping[str, bytes], folder: Path, output: str, flags: Sequence[str] = QUICK) -> Path:
    """A shared library if the name of the output ends in .so, or a program; with `--coverage` it is compiled in the
    folder, where its branches are counted then. Raises LibraryError if the compiler refuses the sources."""
    folder.mkdir(exist_ok=True)
    path = folder / output
    if path.suffix == ".so":
        contents = {name: content for name, content in contents.items() if name != _FUZZ}
        flags = (*flags, "-shared", "-fPIC")
    if "--coverage" not in flags:
        compiler.compile_c(contents, path, compiler=compiler.host_compiler(), flags=flags)
        return path
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    sources_of = sorted(name for name in contents if name.endswith(".c"))
    command = [*compiler.host_compiler(), *compiler.STANDARD, "-Werror", *flags, *sources_of, "-o", path.name]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return path


class Library:
    def __init__(self, contents: Mapping[str, bytes], path: Path) -> None:
        self.structs = Structs(contents, compiler.host_compiler())
        self.ffi = self.structs.ffi
        for found in _DECLARED.findall(contents["node_host.h"].decode()):
            self.ffi.cdef(re.sub(r"(const )?host (?=\*)", "void ", found.replace("const sw_rules", "const uint8_t")))
        self.c = self.ffi.dlopen(str(path))

    def payload(self, bundle: Bundle, length: int) -> bytes:
        """A release's numbers as the stub reads them, and other bytes."""
        release = self.ffi.new("sw_release *")
        release.weights = list(bundle.manifest.mpc.weights.as_tuple())
        release.bundle_hash = bundle.short_hash
        raw = bytes(self.ffi.buffer(release))
        return raw + bytes(i % 251 for i in range(length - len(raw)))


class Host:
    """A node with a flash memory, by `sw_rules`, and its hardware, serial number and software; just powered on, with a
    release that is confirmed, or none if the image is empty."""

    def __init__(self, of: Library, rules: bytes, texts: Sequence[str], image: bytes) -> None:
        self._lib, self._structs = of.c, of.structs
        self._room = of.ffi.new("int64_t[]", self._lib.host_bytes() // 8 + 1)
        self._sent = of.ffi.new("sw_frame[]", 10)
        self._lib.host_init(self._room, rules, SECRET, *(text.encode() for text in texts))
        allowed, digest = keys(), hashlib.sha256(image).digest()
        assert self._lib.host_provision(self._room, allowed, len(allowed), image, len(image), digest) == 0
        self.power_on()

    def power_on(self) -> None:
        self._lib.host_power_on(self._room)

    def fact(self, which: int) -> int:
        return int(self._lib.host_fact(self._room, which))

    def fail(self, what: int) -> None:
        self._lib.host_fail(self._room, what)

    def set(self, slow: int, room: int = 8) -> None:
        """From now on: looks at an erasure until it has ended, and frames that diagnosis may send in a call."""
        self._lib.host_set(self._room, slow, room)

    def control(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        return self._call(self._lib.host_control, now_ns, frames)

    def service(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        return self._call(self._lib.host_service, now_ns, frames)

    def _call(self, function: Any, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        count = function(self._room, now_ns, self._structs.frames(frames), len(frames), self._sent)
        return [self._structs.frame(self._sent[i]) for i in range(count)]
