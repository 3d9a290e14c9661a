"""The outputs of a command. Before its work a command locks and checks the paths that it will write. A file is replaced
only on request.

A second command that would write to a locked path is refused before it begins its work, so no work is lost. A lock is
the system's lock on a hidden file beside the output, `.NAME.lock`. The lock ends when the process ends, so the hidden
file of a killed process has no effect. Linux passes the lock on to an NFS server, so the lock also works between
machines. Windows and some file systems have no such locks; then no command is refused.
"""

import atexit
import os
import socket
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from datetime import date
from itertools import permutations
from pathlib import Path
from typing import Any, Final

from contract.atomic import check_writable, leads_to, names_in
from contract.errors import OutputError, StillwakeError
from contract.results import is_result, versions, write_result
from stillwake.console.terminal import console, listed

DATASET_SUFFIXES: Final = (".h5", ".hdf5")
_HELD: Final = ExitStack()
_PLACES: Final = set[Path]()


def claim(path: Path, *, folder: bool = False) -> None:
    """Lock an output path until the command ends. Raises StillwakeError if nothing can be written at the path, as
    `contract.atomic.check_writable` does; OutputError if another command is writing there."""
    check_writable(path, folder=folder)
    place = leads_to(path)
    if place in _PLACES:
        return
    missing = [parent for parent in place.parents if not parent.exists()]
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        for parent in reversed(missing):
            # `rmdir` does not remove a folder that is not empty.
            _HELD.callback(_quietly, parent.rmdir)
        _lock(path, place.with_name(f".{place.name}.lock"))
    except OSError as error:
        raise StillwakeError(f"cannot write {path}: {error.strerror or error}") from error
    _PLACES.add(place)
    _HELD.callback(_PLACES.discard, place)


@atexit.register
def release() -> None:
    """Release the locks on all output paths of this command."""
    _HELD.close()


def _lock(path: Path, file: Path) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        return
    while True:
        held = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(held, 200).decode(errors="replace").strip()
            os.close(held)
            raise OutputError(
                f"{path}: another command is writing there{f' ({holder})' if holder else ''}; wait until it has ended, "
                "or name another place"
            ) from None
        except OSError:
            # This file system has no locks, so the command continues without a lock.
            os.close(held)
            _quietly(file.unlink)
            return
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(held), file.stat()):
                break
        # The lock's previous holder has removed this file in the meantime. A lock on it would not stop other commands.
        os.close(held)
    with suppress(OSError):
        os.ftruncate(held, 0)
        os.write(held, f"process {os.getpid()} on {socket.gethostname()}\n".encode())
    _HELD.callback(os.close, held)
    _HELD.callback(_quietly, file.unlink)


def _quietly(act: Callable[[], None]) -> None:
    with suppress(OSError):
        act()


def check_dataset_name(path: Path) -> None:
    """Raise OutputError if the file's name does not have the ending of a data set."""
    if path.suffix.lower() not in DATASET_SUFFIXES:
        raise OutputError(f"{path}: a data set is an HDF5 file; its name must end in {' or '.join(DATASET_SUFFIXES)}")


def check_output(
    path: Path, *, overwrite: bool | None, folder: bool = False, occupant: str = "exists already", mark: str = ""
) -> None:
    """Check that an output can be written, and lock its path until the command ends. Raises OutputError if the output
    exists and must not be replaced, or another command writes to the path; StillwakeError if nothing can be written to
    the path.

    Args:
        overwrite: whether the user asked to replace an existing output; None if the output is never replaced.
        folder: whether the output is a folder; an empty folder may exist.
        occupant: description of the existing output, for the error message.
        mark: name of a file that every folder of this kind has; a folder without this file is never replaced.
    """
    claim(path, folder=folder)
    if mark and path.is_dir() and names_in(path) and not (path / mark).exists():
        raise OutputError(f"{path}: holds other files; name another folder")
    if not overwrite and path.exists() and not (folder and not names_in(path)):
        remedy = "give another name" if overwrite is None else "give --overwrite to replace it, or another name"
        raise OutputError(f"{path}: {occupant}; {remedy}")


def check_apart(*paths: Path | None) -> None:
    """Raise OutputError if two paths are equal or one contains the other, because writing one alters the other."""
    for one, other in permutations(filter(None, paths), 2):
        if Path(os.path.realpath(other)).is_relative_to(os.path.realpath(one)):
            raise OutputError(f"{other} is the same path as {one}, or lies in it; name another place")


def check_json(path: Path | None, *others: Path | None) -> None:
    """Check that a file of figures can be written, and lock its path; an existing file of figures is replaced. Raises
    OutputError for a path in `others`, at which the command reads or writes another file, and for an existing file with
    other contents."""
    if path is not None:
        if leads_to(path) in map(leads_to, filter(None, others)):
            raise OutputError(f"--json {path}: this command reads or writes another file there; name another file")
        claim(path)
        if path.exists() and path.stat().st_size > 0 and not is_result(path):
            raise OutputError(f"--json {path}: exists, but contains no figures of a command; name another file")


def check_frames(path: Path | None) -> None:
    """Lock the path of a measurement file, and check that the file can be written in its format."""
    if path is not None:
        from can_bridge.tools.measurement import check_measurement

        claim(path)
        check_measurement(path)


def print_written(path: Path, result: object) -> None:
    """Print that a file was written; for a measurement file, also print the numbers of frames without signals."""
    skipped = listed(result) if isinstance(result, Counter) else ""
    console.print(f"wrote {path}{f'; frames without signals: {skipped}' if skipped else ''}")


def save_json(path: Path | None, *, figures: Any, facts: Mapping[str, Any], packages: Sequence[str] = ()) -> None:
    """Write figures, the facts on which they depend, versions of packages and today's date, unless `path` is None."""
    if path is not None:
        own = {"versions": versions(*packages)} if packages else {}
        write_result(path, figures=figures, facts={**facts, **own}, on=date.today())
