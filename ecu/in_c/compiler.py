"""The C compilers of the host and of the `ziglang` package, and functions that call any of them."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from contract.errors import LibraryError

STANDARD: Final = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion")
OPTIMISED: Final = ("-O3", "-march=native", "-ffp-contract=fast")
"""Flags for speed. They allow fused multiply-adds, which change only roundings; the sources reject -ffast-math."""

EXACT: Final = ("-O3", "-march=native", "-ffp-contract=off")
"""Flags for results equal to Python's, bit for bit. GCC ignores the pragma in the sources and needs the last flag."""


def host_compiler() -> list[str]:
    """Return the command of $CC, cc, gcc, clang, or the compiler of `ziglang`. Raises LibraryError if there is none."""
    named = os.environ.get("CC", "").split()
    if named:
        return named
    for name in ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            return [found]
    if (zig := zig_compiler()) is None:
        raise LibraryError("no C compiler: install gcc or clang, or pip install ziglang")
    return zig


def zig_compiler() -> list[str] | None:
    """Return the command of `ziglang`'s compiler, which can compile for other processors; None if not installed."""
    return None if importlib.util.find_spec("ziglang") is None else [sys.executable, "-m", "ziglang", "cc"]


def compiler_version(compiler: Sequence[str]) -> str:
    """Return the first line that a compiler prints about its version; raise LibraryError if it does not run."""
    return next(iter(_run([*compiler, "--version"], None).stdout.splitlines()), compiler[0]).strip()


def compile_c(contents: Mapping[str, bytes], output: Path, *, compiler: Sequence[str], flags: Sequence[str]) -> None:
    """Compile and link C files; warnings are errors. Raises LibraryError with the compiler's first error message."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in contents.items():
            Path(folder, name).write_bytes(content)
        sources = sorted(name for name in contents if name.endswith(".c"))
        _checked([*compiler, *STANDARD, "-Werror", *flags, *sources, "-o", str(output.resolve())], folder)


def preprocessed(source: Path, *, compiler: Sequence[str], flags: Sequence[str]) -> str:
    """Preprocess a header or source and return the text. Raises LibraryError with the first error message."""
    # The option `-x c` makes the compiler treat a header as C in spite of its file extension.
    return _checked([*compiler, "-E", "-P", *flags, "-x", "c", str(source)], None)


def _checked(command: list[str], folder: str | None) -> str:
    done = _run(command, folder)
    if done.returncode != 0:
        complaints = done.stderr.strip().splitlines() or [f"ended with status {done.returncode}"]
        complaint = next((line for line in complaints if "error" in line), complaints[0][:200])
        raise LibraryError(f"{command[0]}: {complaint}")
    return done.stdout


def _run(command: list[str], folder: str | None) -> subprocess.CompletedProcess[str]:
    run = partial(subprocess.run, command, cwd=folder, capture_output=True, text=True, check=False)
    try:
        done = run()
        if re.match(r"error: unable to \w+ (zig|global) cache directory", done.stderr):
            # If the home folder cannot be written, `ziglang` needs another folder for its cache.
            with tempfile.TemporaryDirectory() as cache:
                done = run(env=os.environ | {"ZIG_GLOBAL_CACHE_DIR": cache})
        return done
    except OSError as error:
        raise LibraryError(f"{command[0]}: {error.strerror or error}") from error
