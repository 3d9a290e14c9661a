"""Compile a C library for a bare Cortex-M7, and its example program for this host, by the compiler in `ziglang`."""

import importlib.util
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final

from contract.controller.host_library import EXAMPLE
from contract.errors import McuError

LINKER_SCRIPT: Final = "cortex_m7.ld"
# Contraction within an expression, as the language allows it, is the same for every target with fused operations.
COMMON: Final = ("-std=c99", "-O3", "-ffp-contract=on", "-g0")
CORTEX_M7: Final = (
    "-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7+fp_armv8d16sp",
    "-ffreestanding", "-nostdlib", "-fno-unwind-tables", "-fno-asynchronous-unwind-tables",
    "-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-Wl,-e,mcu_reset", "-T", LINKER_SCRIPT,
)  # fmt: skip


def compile_for_cortex_m7(sources: Mapping[str, bytes], board: Mapping[str, bytes] | None = None) -> bytes:
    """The library with start-up and linker script as an ELF file.

    Args:
        board: files beside the firmware's, or in place of those of the same name.

    Raises:
        McuError: the sources do not compile, or `ziglang` is not installed.
    """
    folder = files("firmware_sim").joinpath("mcu/c")
    firmware = {item.name: item.read_bytes() for item in folder.iterdir()}
    library = {name: content for name, content in sources.items() if name != EXAMPLE}
    return _compile(library | firmware | dict(board or {}), (*COMMON, *CORTEX_M7))


def compile_example(sources: Mapping[str, bytes]) -> bytes:
    """The example program for this machine; raises as `compile_for_cortex_m7`."""
    return _compile(sources, (*COMMON, "-march=native"))


def _compile(sources: Mapping[str, bytes], flags: Sequence[str]) -> bytes:
    if importlib.util.find_spec("ziglang") is None:
        raise McuError("the compiler is missing: pip install 'stillwake[mcu]'")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, content in sources.items():
            (folder / file).write_bytes(content)
        command = [sys.executable, "-m", "ziglang", "cc", *flags]
        command += [file for file in sorted(sources) if file.endswith(".c")] + ["-o", "program"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            complaint = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr[:200])
            raise McuError(f"compiling for the microcontroller: {complaint}")
        return (folder / "program").read_bytes()
