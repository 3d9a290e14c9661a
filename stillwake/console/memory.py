"""What a command needs of memory is looked up before it loads libraries that would not come back; `__main__` imports
this before numpy.

Where there is no address space for its buffers, OpenBLAS asks for them for ever, and LLVM ends the process without a
word. Both do so under `ulimit -v` or `-d` alone: where the machine itself has too little, the kernel ends a process.
"""

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

LEAST_MB: Final = 150
"""The least address space, by hand, with which Python, numpy and the command line load."""
NEEDS_MB: Final = {
    **dict.fromkeys(("run", "campaign", "vehicle", "live", "latency", "export"), 850),
    **dict.fromkeys(("train", "refine", "mcu"), 750),
    **dict.fromkeys(("record", "picture"), 550),
    **dict.fromkeys(("develop", "plant-fmu"), 450),
}
"""The same of commands that simulate, learn or draw, with one thread of BLAS: with less a short call fails."""
_A_THREAD_MB: Final = 80
"""The address space of each further thread of BLAS, of which numpy and scipy have one each."""
_DATA: Final = 0.5
"""Share of it that is data of its own, which `ulimit -d` bounds."""
_SIGNS: Final = ("failed to map segment", "annot allocate memory", "can't start new thread", "bad_alloc", "to allocate")
"""The signs in the words of the loader, the system, Python, C++ and numpy."""


def shortage(command: str) -> str | None:
    """What is missing, in one line; None where nothing is bounded, or all is there."""
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
    """Raise MemoryError if the command in these words needs more than there is; help needs no more than the least."""
    if words and not {"--help", "-h"} & set(words) and (missing := shortage(words[0])) is not None:
        raise MemoryError(missing)


def lacks_memory(error: BaseException | None) -> bool:
    """Whether an error came of too little memory, in whatever words."""
    while error is not None:
        if isinstance(error, MemoryError) or (
            isinstance(error, ImportError | OSError | RuntimeError) and any(sign in str(error) for sign in _SIGNS)
        ):
            return True
        error = error.__cause__ or error.__context__
    return False


# Nothing of ours is the faster for a second one.
if "OMP_NUM_THREADS" not in os.environ:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if (here := shortage("")) is not None:
    sys.stderr.write(f"error: not enough memory: {here}\n")
    sys.exit(1)
