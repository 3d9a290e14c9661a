"""The build of firmware for a bare Cortex-M7, and of a library's example program, with `ziglang`; a reader of ELF."""

import io
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from elftools.common.exceptions import ELFError
from elftools.elf.elffile import ELFFile

from contract.controller.c_folder import BOARD, library_sources
from contract.errors import LibraryError, McuError, install
from contract.release.signing import PublicKey
from ecu.c.sources import sources_in
from ecu.in_c.compiler import compile_c, zig_compiler
from ecu.in_c.uds_settings import UDS_SETTINGS, uds_settings

LINKER_SCRIPT: Final = "cortex_m7.ld"
NO_COMPILER: Final = f"the compiler is missing: {install('mcu')}"
# Contraction within an expression, as C allows it, gives equal results on all targets with fused multiply-add.
COMMON: Final = ("-O2", "-ffp-contract=on", "-g0")
# The sources already unroll those loops in which this saves time; unrolling all would take 21 KiB more flash. zig's
# defaults, with frame pointers and more inlining, would take 2 KiB more flash and 3 % more time.
BARE: Final = (
    "-target", "thumb-freestanding-eabihf", "-fno-unroll-loops", "-fomit-frame-pointer",
    "-mllvm", "-inline-threshold=20", "-ffreestanding", "-fno-unwind-tables", "-fno-asynchronous-unwind-tables",
    "-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-T",
)  # fmt: skip
BOARD_SCRIPT: Final = "sw_board.ld"
EQUIPMENT: Final = "sw_board_equipment.h"
BUS_KEY: Final = "sw_board_bus_key.h"
"""Headers with values that production replaces. As exported in a library, they enable no loader and contain no key."""


@dataclass(frozen=True, kw_only=True)
class Core:
    """A Cortex-M with the DSP extension and single-precision floating point. The fields are its name for the compiler,
    the clock rates for which times are computed, and whether it issues two instructions per cycle."""

    cpu: str
    clocks_mhz: tuple[int, ...]
    dual_issue: bool


CORTEX_M7: Final = Core(cpu="cortex_m7+fp_armv8d16sp", clocks_mhz=(480, 300), dual_issue=True)
CORTEX_M4F: Final = Core(cpu="cortex_m4+vfp4d16sp", clocks_mhz=(170,), dual_issue=False)


@dataclass(frozen=True, kw_only=True)
class Firmware:
    """A linked program: contents of the flash as (address, bytes), sections' sizes in bytes, symbols' addresses."""

    segments: tuple[tuple[int, bytes], ...]
    sections: dict[str, int]
    symbols: dict[str, int]


def read_elf(image: bytes) -> Firmware:
    """Parse an ELF file. Raises McuError if it is not a complete 32-bit little-endian ELF file."""
    try:
        # The type is Any because pyelftools has no type annotations.
        elf: Any = ELFFile(io.BytesIO(image))
        if elf.elfclass != 32 or not elf.little_endian:
            order = "little" if elf.little_endian else "big"
            raise McuError(f"the image is not a 32-bit little-endian ELF file: {elf.elfclass}-bit, {order}-endian")
        loaded = (item for item in elf.iter_segments("PT_LOAD") if item["p_filesz"])
        tables = elf.iter_sections("SHT_SYMTAB")
        return Firmware(
            segments=tuple((item["p_paddr"], item.data()) for item in loaded),
            sections={item.name: item["sh_size"] for item in elf.iter_sections()},
            symbols={item.name: item["st_value"] for table in tables for item in table.iter_symbols()},
        )
    except ELFError as error:
        raise McuError(f"the image is not a 32-bit little-endian ELF file: {error}") from error


def compile_for_cortex_m7(
    sources: Mapping[str, bytes], board: Mapping[str, bytes] | None = None, *, core: Core = CORTEX_M7
) -> bytes:
    """Compile a library's control step, with start-up code and linker script, for a core with the memories of the
    Cortex-M7; return an ELF file. Files of `board` replace firmware files with the same name. Raises McuError if
    the sources do not compile, or `ziglang` is not installed."""
    firmware = {item.name: item.read_bytes() for item in files("firmware_sim").joinpath("mcu/c").iterdir()}
    firmware["sw_board_libc.c"] = sources_in("board")["sw_board_libc.c"]
    return _linked(library_sources(sources) | firmware | dict(board or {}), LINKER_SCRIPT, "mcu_reset", core)


def compile_board(sources: Mapping[str, bytes], own: Mapping[str, bytes] | None = None) -> bytes:
    """Compile the whole firmware of a board, including its vector table; return an ELF file. `sources` are the sources
    of a library with ECU and board, by path in its folder; files of `own` replace sources with the same name. Raises
    LibraryError for a library without a board; McuError if the sources do not compile, or `ziglang` is missing."""
    return _linked(board_files(sources, own), BOARD_SCRIPT, "sw_board_start", CORTEX_M7)


def board_files(sources: Mapping[str, bytes], own: Mapping[str, bytes] | None = None) -> dict[str, bytes]:
    """Return the files that `compile_board` compiles; raises LibraryError for a library without a board."""
    parts = {part: {n.split("/")[1]: sources[n] for n in sources if n.startswith(f"{part}/")} for part in BOARD}
    board, loader = (parts[part] for part in BOARD)
    if BOARD_SCRIPT not in board:
        raise LibraryError(f"{BOARD[0]}/{BOARD_SCRIPT} is missing: this library has no board; export it again")
    if own is None or EQUIPMENT not in own:
        loader = {"sw_flash.h": loader["sw_flash.h"]}
    return library_sources(sources) | loader | board | {UDS_SETTINGS: uds_settings()} | dict(own or {})


def bus_key_header(secret: bytes) -> bytes:
    """Return the header `BUS_KEY` with a key of the bus."""
    return f"#define SW_BOARD_BUS_KEY {{{', '.join(map(str, secret))}}}\n".encode()


def equipment_header(root: PublicKey, access_key: bytes, vehicle: bytes, hardware: str, serial: str) -> bytes:
    """Return the header that enables the loader. `root` checks key lists, and `access_key` is the key of security
    access, 16 bytes. `vehicle` is `contract.release.controller_image.ImageFacts.vehicle` of every image for this
    vehicle. `hardware` and `serial` of the board are printable ASCII without quotes."""
    numbers = {"ROOT": root.raw, "ACCESS_KEY": access_key, "VEHICLE": vehicle}
    found = {name: "{" + ", ".join(map(str, value)) + "}" for name, value in numbers.items()} | {
        "LOADER": "1", "HARDWARE": f'"{hardware}"', "SERIAL": f'"{serial}"', "SOFTWARE": '"board"',
    }  # fmt: skip
    return "".join(f"#define SW_BOARD_{name} {value}\n" for name, value in found.items()).encode()


def _linked(contents: Mapping[str, bytes], script: str, entry: str, core: Core) -> bytes:
    with tempfile.TemporaryDirectory() as place:
        image = Path(place, "firmware.elf")
        compile_with_zig(contents, image, (*COMMON, *BARE, script, f"-Wl,-e,{entry}", f"-mcpu={core.cpu}"))
        return image.read_bytes()


def compile_with_zig(sources: Mapping[str, bytes], output: Path, flags: Sequence[str]) -> None:
    """Compile for the target that the flags select. Raises McuError as `compile_for_cortex_m7` does."""
    compiler = zig_compiler()
    if compiler is None:
        raise McuError(NO_COMPILER)
    try:
        compile_c(sources, output, compiler=compiler, flags=flags)
    except LibraryError as error:
        raise McuError(f"compiling for the microcontroller failed: {error}") from error
