"""The parts of the ECU in C that face the wire, compiled for this host with both sets of messages, and called.

UBSan is on where GCC compiles: what it finds ends the test's process.
"""

import re
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, Literal

import cffi

from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import MessageSet, message_set
from contract.config.tree import Config
from contract.release.bundle import Bundle, load
from export.program.random_program import random_program
from export.to_c.library import c_library
from firmware_sim.in_c.c_settings import HEADER, ecu_settings
from firmware_sim.in_c.compiler import host_compiler
from stillwake.parts.c_samples import MODEL, MPC

PARTS: Final = ("sw_e2e.c", "sw_codec_fd.c", "sw_codec_classic.c", "sw_receiver.c", "sw_reception.c")
INTERFACE: Final = "sw_ecu_parts.h"
SOURCES: Final = Path(str(files("export.to_c"))) / "sources" / "ecu"
FRAMES: Final = ("fd", "classic")
"""Values of `bus.frames`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Parts:
    """One build.

    Attributes:
        lib: the functions of `sw_ecu_parts.h`.
        ffi: makes their arguments.
        config: the vehicle it was built for.
        messages: the set it speaks.
        bundle: the release it was built for.
    """

    lib: Any
    ffi: Any
    config: Config
    messages: MessageSet
    bundle: Bundle

    def frames(self, frames: Sequence[Frame]) -> Any:
        """The same frames in C."""
        return self.ffi.new("sw_frame[]", [self.frame(frame) for frame in frames])

    def frame(self, frame: Frame) -> dict[str, object]:
        """What cffi makes a frame of."""
        return {
            "timestamp_ns": frame.timestamp_ns,
            "id": frame.frame_id,
            "is_extended": frame.is_extended,
            "is_fd": frame.is_fd,
            "length": len(frame.data),
            "data": frame.data,
        }


def vehicle(frames: Literal["fd", "classic"]) -> Config:
    """The default vehicle with one of the sets of messages."""
    config = Config()
    ecu = replace(config.ecu, sensor_check=replace(config.ecu.sensor_check, enabled=False))
    return replace(config, bus=replace(config.bus, frames=frames), ecu=ecu)


def built(
    release: Path, folder: Path, config: Config, compile_c: Callable[..., None], sources: Sequence[str] = PARTS
) -> Parts:
    """The parts of these sources for one vehicle with a release."""
    bundle = load(release)
    library = c_library(random_program(0, model=MODEL, mpc=MPC))
    contents = {name: text for name, text in library.items() if name.endswith(".h")}
    contents |= {item.name: item.read_bytes() for item in SOURCES.iterdir() if item.name.endswith(".h")}
    contents |= {HEADER: ecu_settings(bundle, config)}
    flags = ["-shared", "-fPIC", "-O1", "-g1"]
    compiler = ["gcc"] if shutil.which("gcc") else host_compiler()
    if compiler == ["gcc"]:
        flags += ["-fsanitize=undefined,float-cast-overflow", "-fno-sanitize-recover=all"]
    path = folder / "parts.so"
    compile_c(
        contents | {name: (SOURCES / name).read_bytes() for name in sources}, path, compiler=compiler, flags=flags
    )
    ffi = cffi.FFI()
    ffi.cdef(declarations(contents, folder, compiler))
    return Parts(lib=ffi.dlopen(str(path)), ffi=ffi, config=config, messages=message_set(config.bus), bundle=bundle)


def declarations(headers: dict[str, bytes], folder: Path, compiler: Sequence[str]) -> str:
    """`sw_ecu_parts.h` for cffi, which knows the types of the standard headers by itself."""
    place = folder / "headers"
    place.mkdir()
    # The workspace is the last member of the ECU, and no part here looks at it.
    opaque = {"sw_workspace.h": b"typedef struct { char unused; } sw_workspace;\n", "stdint.h": b"", "stddef.h": b""}
    for name, content in (headers | opaque).items():
        (place / name).write_bytes(content)
    command = [*compiler, "-E", "-P", "-nostdinc", "-I.", INTERFACE]
    text = subprocess.run(command, cwd=place, capture_output=True, text=True, check=True).stdout
    return re.sub(r"^#.*$", "", text, flags=re.MULTILINE)
