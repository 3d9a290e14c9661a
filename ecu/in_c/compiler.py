"""C compilers: the host's, the one in the `ziglang` package, and one way to call any of them."""

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from contract.errors import LibraryError

STANDARD: Final = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion")
OPTIMISED: Final = ("-O3", "-march=native", "-ffp-contract=fast")
"""Contraction to fused multiply-adds changes roundings only; -ffast-math would break them."""

EXACT: Final = ("-O3", "-march=native", "-ffp-contract=off")
"""The ECU decides with these to the bit as the one in Python: GCC reads no pragma against contraction."""


def host_compiler() -> list[str]:
    """The command that compiles C here: $CC, else cc, gcc or clang, else the `ziglang` package's. Raises LibraryError
    if there is none."""
    named = os.environ.get("CC", "").split()
    if named:
        return named
    for name in ("cc", "gcc", "clang"):
        found = shutil.which(name)
        if found:
            return [found]
    found_zig = zig_compiler()
    if found_zig is None:
        raise LibraryError("no C compiler: install gcc or clang, or pip install ziglang")
    return found_zig


def zig_compiler() -> list[str] | None:
    """The command of the `ziglang` package, which compiles for other processors too; None if it is not installed."""
    if importlib.util.find_spec("ziglang") is None:
        return None
    return [sys.executable, "-m", "ziglang", "cc"]


def compiler_version(compiler: Sequence[str]) -> str:
    """The first line that the compiler prints about itself; raises LibraryError if it does not run."""
    return next(iter(_run([*compiler, "--version"], None).stdout.splitlines()), compiler[0]).strip()


def compile_c(contents: Mapping[str, bytes], output: Path, *, compiler: Sequence[str], flags: Sequence[str]) -> None:
    """Compile and link all C files given, warnings as errors. Raises LibraryError if the compiler does not take them;
    the message has its first complaint."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in contents.items():
            Path(folder, name).write_bytes(content)
        sources = sorted(name for name in contents if name.endswith(".c"))
        done = _run([*compiler, *STANDARD, "-Werror", *flags, *sources, "-o", str(output.resolve())], folder)
    if done.returncode != 0:
        raise LibraryError(f"{compiler[0]}: {_complaint(done)}")


def preprocessed(source: Path, *, compiler: Sequence[str], flags: Sequence[str]) -> str:
    """A header or source as the compiler sees it, without its line markers. Raises LibraryError if the preprocessor
    does not take it; the message has its first complaint."""
    # A header by itself is compiled as C, whatever its name ends in.
    done = _run([*compiler, "-E", "-P", *flags, "-x", "c", str(source)], None)
    if done.returncode != 0:
        raise LibraryError(f"{compiler[0]}: {_complaint(done)}")
    return done.stdout


def _complaint(done: subprocess.CompletedProcess[str]) -> str:
    complaints = done.stderr.strip().splitlines() or [f"ended with status {done.returncode}"]
    return next((line for line in complaints if "error" in line), complaints[0][:200])


def _run(command: list[str], folder: str | None) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    except OSError as error:
        raise LibraryError(f"{command[0]}: {error.strerror or error}") from error
