"""Branches of the store's C that calls, cuts, worn words and judged images take, by gcc and gcovr."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from contract.errors import LibraryError
from tests.proofs.loader_in_c.store_library import GEOMETRY, OWN, TWIN, Library, sources

_MEASURED: Final = frozenset(OWN) - {"sw_sha512.c"}


class Coverage(NamedTuple):
    """Branches taken, all of them, and the places of those that are not: `file:line: text`."""

    covered: int
    branches: int
    missed: list[str]


def measured(folder: Path, exercise: Callable[[Library], None]) -> Coverage:
    """What is taken in the library that is handed over; raises LibraryError if gcc does not take it."""
    for name, content in sources().items():
        (folder / name).write_bytes(content)
    output = folder / "store.so"
    command = [
        "gcc", "-std=c99", "-w", "-O0", "--coverage", "-fPIC", "-shared", "-DTWIN_COVERAGE", *GEOMETRY, *OWN, TWIN,
        "-o", str(output),
    ]  # fmt: skip
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise LibraryError(f"gcc: {done.stderr.splitlines()[0]}")
    library = Library.loaded(output)
    exercise(library)
    library.ffi.cdef("void twin_dump(void);")
    library.c.twin_dump()
    report = folder / "coverage.json"
    command = [sys.executable, "-m", "gcovr", "--root", str(folder), "--json", str(report), str(folder)]
    subprocess.run([*command, "--merge-mode-functions", "separate"], cwd=folder, capture_output=True, check=True)
    covered, branches, missed = 0, 0, set[str]()
    for file in json.loads(report.read_text())["files"]:
        text = (folder / file["file"]).read_text().splitlines()
        for line in file["lines"] if file["file"] in _MEASURED else ():
            for branch in line["branches"]:
                branches += 1
                covered += branch["count"] > 0
                if not branch["count"]:
                    missed.add(f"{file['file']}:{line['line_number']}: {text[line['line_number'] - 1].strip()}")
    return Coverage(covered, branches, sorted(missed))
