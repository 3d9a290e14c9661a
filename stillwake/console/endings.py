"""The end of a command: its exit status, and one line to stderr for every failure that a user can cause."""

import errno
import os
import sys
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from pathlib import Path
from typing import Final

from contract.errors import StillwakeError, install
from stillwake.console.outputs import release
from stillwake.console.start import ROOMS, explain, lacks_memory
from stillwake.console.stopping import INTERRUPTED, outcome
from stillwake.console.terminal import make_console, visible

EXTRAS: Final[Mapping[str, tuple[str, ...]]] = {
    "sim": (
        *("h5py", "numba", "scipy", "gymnasium", "matplotlib", "PIL", "distributed", "dask", "tzdata"),
        *("jinja2", "llvmlite", "tornado"),
    ),
    "c": ("onnx", "safetensors", "h5py", "cyclonedx"),
    "train": ("torch", "shap", "onnx", "safetensors", "h5py", "scipy", "cyclonedx", "tzdata"),
    "bus": ("serial", "msgpack", "cantools"),
    "flash": ("udsoncan", "isotp"),
    "mcu": ("ziglang", "unicorn", "capstone", "elftools"),
    "fmu": ("pythonfmu3",),
    "mdf": ("asammdf",),
    "mcap": ("mcap_protobuf", "foxglove_schemas_protobuf"),
}
"""The packages that each extra of `pyproject.toml` installs, by their import names."""
_FIRST: Final = {"train": "train", "export": "c", "mcu": "c"}
"""The extra that an error message of a command recommends if several extras install the missing package."""
REPORT: Final = "this is an error in stillwake: please report it with the lines above"

errors = make_console(stderr=True)


def status_of(command: Callable[[], object]) -> int:
    """Run a command to its end; return its exit status. If the command failed, one line is printed to stderr.

    An exception that no user should be able to cause is printed with its traceback. A further line asks the user to
    report it.
    """
    try:
        try:
            status = _status_of(command)
        finally:
            release()
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:
        # When Python exits, it would try to write the rest of the buffer and fail, too. So the output is redirected.
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1 if error.errno == errno.EPIPE else _fail(f"cannot write to standard output: {_reason(error)}")
    return status


def _status_of(command: Callable[[], object]) -> int:
    try:
        command()
    except SystemExit as stop:
        # typer ends with SystemExit, also after Ctrl-C.
        if isinstance(stop.code, str):
            return _fail(stop.code)
        return _stopped() if stop.code == INTERRUPTED else stop.code or 0
    except KeyboardInterrupt:
        return _stopped()
    except StillwakeError as error:
        return _out_of_memory(error) if lacks_memory(error) else _fail(str(error), status=error.status)
    except ModuleNotFoundError as error:
        return _fail(missing(error.name or str(error), sys.argv[1] if len(sys.argv) > 1 else ""))
    except BrokenExecutor:
        return _fail("a worker process ended: it was killed, perhaps because there was not enough memory")
    except OSError as error:
        if lacks_memory(error):
            return _out_of_memory(error)
        if error.filename is None and error.errno in (errno.EPIPE, errno.ENOSPC):
            raise
        return _fail(_reason(error))
    except Exception as error:  # noqa: BLE001  (a fault of ours ends with its traceback, and a line on what to do)
        if lacks_memory(error):
            return _out_of_memory(error)
        with suppress(OSError):
            traceback.print_exc()
        return _fail(REPORT)
    return 0


def missing(module: str, command: str = "") -> str:
    """Return a line that tells the user how to install a module that this command could not import."""
    top = module.partition(".")[0]
    loaded = sys.modules.get(top)
    place = None if loaded is None else getattr(loaded, "__file__", None)
    if loaded is not None and "." in module:
        if top in ROOMS:
            return explain(top, Path(place or "?"))
        return f"{place or top} has no module {module!r}: it may be another version, or a file of that name"
    for extra in sorted(EXTRAS, key=lambda extra: extra != _FIRST.get(command)):
        if top in EXTRAS[extra]:
            return f"this command needs {top}: {install(extra)}"
    return f"this command needs {top}, which is not installed"


def _out_of_memory(error: Exception) -> int:
    return _fail(f"not enough memory{f': {error}' if str(error) else ''}")


def _stopped() -> int:
    status, line = outcome()
    return _fail(line, status=status, prefix="")


def _fail(line: str, *, status: int = 1, prefix: str = "error: ") -> int:
    text = " ".join(part.strip() for part in visible(f"{prefix}{line}").splitlines())
    with suppress(OSError):
        errors.print(text, style="red")
    return status


def _reason(error: OSError) -> str:
    text = error.strerror or str(error) or type(error).__name__
    return text if error.filename is None else f"{os.fsdecode(error.filename)}: {text}"
