"""Every C build of the tests once: the same files, compiler and flags give the same file, whoever asks for it.

Builds are kept in pytest's cache directory under the hash of all that they are made from, so that workers of one
session share them, and the next session finds them. `compile_c` keeps its arguments and errors; what does not compile
is not kept.
"""

import hashlib
import os
import shutil
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from filelock import FileLock

from ecu.in_c import compiler as compilers

MODULES = (
    "ecu.in_c.compiler",
    "ecu.in_c.host_library",
    "ecu.in_c.c_ecu",
    "docs.site.browser_ecu",
    "firmware_sim.fmu.ecu_fmu",
    "firmware_sim.mcu.build",
)
"""Where `compile_c` is called by its name."""

KEPT_S = 14 * 24 * 3600.0

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
                compile_c(contents, unfinished, compiler=compiler, flags=flags)
                unfinished.replace(built)
            os.utime(built)
            shutil.copy(built, output)


def _key(contents: Mapping[str, bytes], compiler: Sequence[str], flags: Sequence[str]) -> str:
    made_from = (sorted(contents.items()), _version(tuple(compiler)), list(compiler), list(flags))
    return hashlib.sha256(repr(made_from).encode()).hexdigest()


@cache
def _version(compiler: tuple[str, ...]) -> str:
    return compilers.compiler_version(compiler)
