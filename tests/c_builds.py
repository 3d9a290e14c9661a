"""Every C build of the tests once: the same files, compiler and flags give the same file, whoever asks for it.

Builds are kept in pytest's cache directory under the hash of all that they are made from, so that workers of one
session share them, and the next session finds them. So is every object file: of a build that differs in one source,
one source is compiled. `compile_c` keeps its arguments and errors; what does not compile is not kept.
"""

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from filelock import FileLock

from ecu.in_c import compiler as compilers

MODULES = (
    *("ecu.in_c.compiler", "ecu.in_c.host_library", "ecu.in_c.c_ecu", "docs.site.browser_ecu"),
    *("firmware_sim.fmu.fmu_files", "firmware_sim.mcu.build"),
)
"""Where `compile_c` is called by its name."""

KEPT_S = 14 * 24 * 3600.0
_INCLUDED = re.compile(rb"^[ \t]*#[ \t]*include[ \t]*([^\s<].*)", re.MULTILINE)
_LINKING = ("-shared", "-static", "-r", "-Wl,", "-l", "-L", "-nostd", "-nostart")
"""Beginnings of flags that concern the linker alone: clang takes them for a mistake where it only compiles."""
_WHOLE = ("ziglang", "-c", "-E", "-S", "-fsyntax-only", "-include", "-T", "--coverage", "-flto")
"""A command with one of these is left as it is; zig keeps objects itself."""

compile_c = compilers.compile_c
"""The function itself, whatever stands in its place."""


class SharedBuilds:
    """Builds in a folder, made when they are first asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        for built in folder.iterdir():
            if time.time() - built.stat().st_mtime > KEPT_S:
                built.unlink(missing_ok=True)

    def compile_c(
        self, contents: Mapping[str, bytes], output: Path, *, compiler: Sequence[str], flags: Sequence[str]
    ) -> None:
        """As `ecu.in_c.compiler.compile_c`."""
        built = self._folder / _key(contents, compiler, flags)
        with FileLock(f"{built}.lock"):
            if not built.exists():
                unfinished = built.with_suffix(".part")
                if not self._linked(contents, unfinished, compiler, flags):
                    compile_c(contents, unfinished, compiler=compiler, flags=flags)
                unfinished.replace(built)
            os.utime(built)
            shutil.copy(built, output)

    def quick(self, contents, output, *, compiler, flags: Sequence[str]) -> None:
        """Compile at -O1 what is not contracted: its bits are those of -O3 (tests/ecu/in_c/test_estimator_in_c.py)."""
        if {"-O3", "-ffp-contract=off"} <= set(flags):
            flags = ["-O1" if flag == "-O3" else flag for flag in flags if flag != "-march=native"]
        self.compile_c(contents, output, compiler=compiler, flags=flags)

    def _linked(self, files: Mapping[str, bytes], output: Path, compiler: Sequence[str], flags: Sequence[str]) -> bool:
        """Link kept objects and new ones; False where the compiler is to be asked for all at once, and for errors."""
        sources = sorted(name for name in files if name.endswith(".c"))
        if len(sources) < 2 or any(word in _WHOLE for word in (*compiler, *flags)):
            return False
        used = [flag for flag in flags if not flag.startswith(_LINKING)]
        kept = {name: self._folder / f"{_key(needed(files, name), compiler, used)}.o" for name in sources}
        new = [name for name in sources if not kept[name].exists()]
        with tempfile.TemporaryDirectory() as folder:
            for name, content in files.items():
                Path(folder, name).write_bytes(content)
            command = [*compiler, *compilers.STANDARD, "-Werror", *used, "-c", *new]
            if new and subprocess.run(command, cwd=folder, capture_output=True, check=False).returncode != 0:
                return False
            for name in new:
                unfinished = kept[name].with_suffix(f".{os.getpid()}")
                shutil.copy(Path(folder, name).with_suffix(".o"), unfinished)
                unfinished.replace(kept[name])
            for path in kept.values():
                os.utime(path)
            command = [*compiler, *flags, *map(str, kept.values()), "-o", str(output.resolve())]
            return subprocess.run(command, cwd=folder, capture_output=True, check=False).returncode == 0


def needed(contents: Mapping[str, bytes], source: str) -> dict[str, bytes]:
    """A source with all that it includes of these files; all of them, if it includes by a macro's name."""
    found, left = dict[str, bytes](), [source]
    while left:
        name = left.pop()
        if name in contents and name not in found:
            found[name] = contents[name]
            for words in _INCLUDED.findall(contents[name]):
                if not words.startswith(b'"'):
                    return dict(contents)
                left.append(words.split(b'"')[1].decode())
    return found


def _key(contents: Mapping[str, bytes], compiler: Sequence[str], flags: Sequence[str]) -> str:
    made_from = (sorted(contents.items()), _version(tuple(compiler)), list(compiler), list(flags))
    return hashlib.sha256(repr(made_from).encode()).hexdigest()


@cache
def _version(compiler: tuple[str, ...]) -> str:
    return compilers.compiler_version(compiler)
