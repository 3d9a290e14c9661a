"""Locks that let only one command at a time write to an output file or folder. A second command is refused before it
begins its work, so no work is lost.

A lock is the system's lock on a hidden file beside the output, `.NAME.lock`. It ends with the process in every case; a
hidden file that a killed process left has no effect. Linux passes the lock on to an NFS server, so that it also works
between machines. Windows and some file systems have no such locks; no command is refused on these systems.
"""

import atexit
import os
import socket
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final

from contract.atomic import check_writable, leads_to
from contract.errors import OutputError, StillwakeError

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
        # The lock's previous holder has removed the file in the meantime, so a lock on it does not stop other commands.
        os.close(held)
    with suppress(OSError):
        os.ftruncate(held, 0)
        os.write(held, f"process {os.getpid()} on {socket.gethostname()}\n".encode())
    _HELD.callback(os.close, held)
    _HELD.callback(_quietly, file.unlink)


def _quietly(act: Callable[[], None]) -> None:
    with suppress(OSError):
        act()
