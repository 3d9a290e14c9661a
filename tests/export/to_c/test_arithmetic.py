"""A build that computes otherwise is refused when it is compiled or by its known answer; others are right."""

import platform
import shutil
import subprocess
from pathlib import Path

import pytest

from contract.controller.c_folder import ECU_SETTINGS, library_sources
from contract.errors import LibraryError
from ecu.c.sources import firmware_sources
from ecu.in_c.c_settings import ecu_settings
from ecu.in_c.compiler import compile_c, zig_compiler
from examples.random_programs import random_program
from export.to_c.library import c_library
from tests.each import each
from tests.ecu.in_c.exported import CONFIG
from tests.proofs.ecu_in_c.variants import bundle_of

pytestmark = pytest.mark.compiler

MAIN = Path(__file__).with_name("c").joinpath("arithmetic.c").read_bytes()
FUSES = platform.machine() == "x86_64" and " fma " in Path("/proc/cpuinfo").read_text()
RIGHT, WRONG, FUSED = "0 0", "2 5", "0 5"
"""SW_OK or SW_WRONG_ARITHMETIC, then SW_REASON_NONE or SW_REASON_INTERNAL."""
REFUSED = (
    "-ffast-math",
    "-funsafe-math-optimizations",
    "-fassociative-math -fno-signed-zeros -fno-trapping-math",
    "-freciprocal-math",
    "-ffinite-math-only",
    "-fno-signed-zeros",
    "-O1 -funsafe-math-optimizations",
    "-O3 -freciprocal-math -march=native",
)
BY_ONE = {
    "gcc": (
        *("-Ofast", "-fsingle-precision-constant", "-mfpmath=387", "-mfpmath=both"),
        "-U__DBL_MANT_DIG__ -D__DBL_MANT_DIG__=24",  # double of 32 bits
        "-U__FLT_EVAL_METHOD__ -D__FLT_EVAL_METHOD__=2",  # more digits than the type has
    ),
    "clang": ("-fno-honor-nans", "-ffp-model=fast"),
    "zig": ("-fno-honor-nans", "-ffp-model=fast", "-ffp-eval-method=double", "-ffp-model=aggressive"),
}
"""That one compiler knows."""
HARMLESS = (
    "-O0",
    "-O3 -march=native -ffp-contract=off",
    "-Os -fno-trapping-math",
    "-frounding-math -fno-math-errno -fno-builtin",
)


COMPILERS = {"gcc": ["gcc"], "clang": ["clang"], "zig": zig_compiler() or [""]}


@pytest.fixture(scope="module")
def sources() -> dict[str, bytes]:
    """All that the known answers stand in and need, of a small program's library."""
    own = {ECU_SETTINGS: ecu_settings(bundle_of(CONFIG), CONFIG)}
    contents = library_sources(c_library(random_program(1)) | firmware_sources() | own)
    kept = ("sw_arithmetic.c", "sw_inexact.c")
    return {name: text for name, text in contents.items() if name.endswith(".h") or name in kept} | {"main.c": MAIN}


def answers(sources, command: list[str], flags: str, folder: Path) -> list[str]:
    """Of each mode of the processor; of none where the compiler refuses."""
    try:
        compile_c(sources, folder / "try", compiler=command, flags=("-O2", "-ffp-contract=off", *flags.split()))
    except LibraryError as error:
        assert "#error" in str(error) or "sw_compiler.h" in str(error) or "sw_compile_without" in str(error), flags
        return []
    return subprocess.run([folder / "try"], capture_output=True, text=True, check=True).stdout.splitlines()


@each("name, command", COMPILERS.items())
def test_flags_that_change_arithmetic_are_refused_one_by_one_and_so_are_modes(sources, name, command, tmp_path):
    if shutil.which(command[0]) is None or platform.machine() != "x86_64":
        return
    # zig is clang, with defaults of its own.
    known = name == "zig" and shutil.which("clang") is not None
    for flags in BY_ONE[name][-2:] if known else (*REFUSED, *BY_ONE[name]):
        assert set(answers(sources, command, flags, tmp_path)) <= {WRONG}, flags
    for flags in HARMLESS[-1:] if known else HARMLESS:
        plain, *modes, again = answers(sources, command, flags, tmp_path)
        assert (plain, again) == (RIGHT, RIGHT), flags
        assert len(modes) == 5 and set(modes) == {WRONG}, flags
    if FUSES and not known:
        # The control step may be contracted, decisions may not.
        assert answers(sources, command, "-march=native -ffp-contract=fast", tmp_path)[0] == FUSED
