"""Compile a C library for a bare Cortex-M7, and its example program for this host, by the compiler in `ziglang`."""

import tempfile
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final

from contract.controller.c_folder import library_sources
from contract.controller.compiler import compile_c, zig_compiler
from contract.errors import LibraryError, McuError

LINKER_SCRIPT: Final = "cortex_m7.ld"
# Contraction within an expression, as the language allows it, is the same for every target with fused operations.
COMMON: Final = ("-O3", "-ffp-contract=on", "-g0")
CORTEX_M7: Final = (
    "-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7+fp_armv8d16sp",
    "-ffreestanding", "-nostdlib", "-fno-unwind-tables", "-fno-asynchronous-unwind-tables",
    "-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-Wl,-e,mcu_reset", "-T", LINKER_SCRIPT,
)  # fmt: skip


def compile_for_cortex_m7(sources: Mapping[str, bytes], board: Mapping[str, bytes] | None = None) -> bytes:
    """The library with start-up and linker script as an ELF file.

    Args:
        board: files next to the firmware's, or in place of those of the same name.

    Raises:
        McuError: the sources do not compile, or `ziglang` is not installed.
    """
    folder = files("firmware_sim").joinpath("mcu/c")
    firmware = {item.name: item.read_bytes() for item in folder.iterdir()}
    with tempfile.TemporaryDirectory() as place:
        image = Path(place, "firmware.elf")
        _compile(library_sources(sources) | firmware | dict(board or {}), image, (*COMMON, *CORTEX_M7))
        return image.read_bytes()


def compile_replay(sources: Mapping[str, bytes], program: Path) -> None:
    """The example program for this machine; raises as `compile_for_cortex_m7`."""
    _compile(sources, program, (*COMMON, "-march=native"))


def _compile(sources: Mapping[str, bytes], output: Path, flags: Sequence[str]) -> None:
    compiler = zig_compiler()
    if compiler is None:
        raise McuError("the compiler is missing: pip install 'stillwake[mcu]', or in a checkout pip install '.[mcu]'")
    try:
        compile_c(sources, output, compiler=compiler, flags=flags)
    except LibraryError as error:
        raise McuError(f"compiling for the microcontroller: {error}") from error
