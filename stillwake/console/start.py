"""The checks before anything else is loaded: no file of the user hides a package of the project, and there is enough
memory. `__main__` imports this module first.

The packages have everyday names, and `python -m stillwake` searches the working folder before the installed packages.
So a user's `train.py` in the working folder would run in place of the package `train`.

If the address space is too small, OpenBLAS requests its buffers without end, and LLVM ends the process without a
message. Both occur only with a limit set by `ulimit -v` or `-d`. If the machine itself has too little memory, the
kernel ends a process.
"""

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Final

ROOMS: Final = ("contract", "wake", "train", "export", "can_bridge", "ecu", "firmware_sim", "stillwake")
HOME: Final = Path(__file__).resolve().parents[2]
"""The folder that contains all packages."""
LEAST_MB: Final = 150
"""Smallest address space in MB with which Python, numpy and the command line load (measured once)."""
NEEDS_MB: Final = {
    **dict.fromkeys(("run", "campaign", "vehicle", "live", "latency", "export"), 850),
    **dict.fromkeys(("train", "refine", "mcu"), 750),
    **dict.fromkeys(("record", "picture"), 550),
    **dict.fromkeys(("develop", "plant-fmu"), 450),
}
"""Smallest address space in MB for each command that simulates, trains or draws, with one thread of BLAS."""
_A_THREAD_MB: Final = 80
"""Address space in MB for each further thread of BLAS; numpy and scipy each load their own BLAS."""
_DATA: Final = 0.5
"""Share of a process's address space that is private data, which `ulimit -d` limits."""
_SIGNS: Final = ("failed to map segment", "annot allocate memory", "can't start new thread", "bad_alloc", "to allocate")
"""Parts of the error messages with which the loader, the system, Python, C++ and numpy report that memory is short."""


def hidden(rooms: Sequence[str] = ROOMS, home: Path = HOME) -> tuple[str, Path] | None:
    """Return the first of the project's packages that Python finds outside the folder `home`, and where Python finds
    it; None if there is no such package."""
    for room in rooms:
        spec = find_spec(room)
        if spec is None:
            continue
        places = [spec.origin] if spec.origin else list(spec.submodule_search_locations or [])
        files = [Path(place).resolve() for place in places if place]
        if files and not any(path.is_relative_to(home / room) for path in files):
            return room, files[0]
    return None


def explain(room: str, file: Path) -> str:
    """Return one line that tells the user how to remove the conflict between a package and a file."""
    return f"{file} hides the package {room!r} of stillwake: rename the file, or call `stillwake` from another folder"


def shortage(command: str) -> str | None:
    """Return one line that states the memory limit and the memory that a command needs; None if no limit is too low."""
    threads = os.environ.get("OPENBLAS_NUM_THREADS", os.environ.get("OMP_NUM_THREADS", ""))
    more = min(int(threads), os.cpu_count() or 1) - 1 if threads.isdigit() else 0
    needs = NEEDS_MB.get(command, LEAST_MB) + _A_THREAD_MB * max(0, more)
    with suppress(ImportError):  # where there is no such limit
        import resource

        for kind, option, share in ((resource.RLIMIT_AS, "-v", 1.0), (resource.RLIMIT_DATA, "-d", _DATA)):
            allowed, least = resource.getrlimit(kind)[0], round(needs * share)
            if allowed != resource.RLIM_INFINITY and allowed < least << 20:
                return (
                    f"ulimit {option} allows {allowed >> 20} MB, {command or 'stillwake'} needs {least}: "
                    f"set it to {least << 10} or more"
                )
    return None


def check_memory(words: Sequence[str]) -> None:
    """Raise MemoryError if the command in `words` needs more memory than the limits allow. A call with --help is always
    accepted."""
    if words and not {"--help", "-h"} & set(words) and (missing := shortage(words[0])) is not None:
        raise MemoryError(missing)


def lacks_memory(error: BaseException | None) -> bool:
    """Return whether an error, by its type or its message, reports that memory is short."""
    while error is not None:
        if isinstance(error, MemoryError) or (
            isinstance(error, ImportError | OSError | RuntimeError) and any(sign in str(error) for sign in _SIGNS)
        ):
            return True
        error = error.__cause__ or error.__context__
    return False


if (other := hidden()) is not None:
    sys.stderr.write(f"error: {explain(*other)}\n")
    sys.exit(1)
# Nothing in the project is faster with a second thread of BLAS.
if "OMP_NUM_THREADS" not in os.environ:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if (here := shortage("")) is not None:
    sys.stderr.write(f"error: not enough memory: {here}\n")
    sys.exit(1)
