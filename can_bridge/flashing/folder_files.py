"""The few things that the folder backing asks of a file system, each one call, so that tests can cut between them.

What a disk may lose with its supply: of a file, whatever was not synchronised; of a folder, every name that was given
or changed since the folder was.
"""

import errno
import os
import stat
from pathlib import Path

from can_bridge.flashing.medium import MediumError


class FolderFiles:
    """Files in one folder, by their names; every method raises MediumError if the system refuses."""

    def __init__(self, folder: Path) -> None:
        """Make the folder if it is not there."""
        self._folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _failed(folder, error) from error

    def read(self, name: str, offset: int = 0, length: int | None = None) -> bytes | None:
        """Bytes of a file, fewer where it ends; None if there is no such file."""
        try:
            with os.fdopen(open_regular(self._folder / name, os.O_RDONLY), "rb") as file:
                file.seek(offset)
                return file.read() if length is None else file.read(length)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise _failed(self._folder / name, error) from error

    def size(self, name: str) -> int:
        """Bytes of a file; 0 if there is no such file."""
        try:
            return (self._folder / name).stat().st_size
        except FileNotFoundError:
            return 0
        except OSError as error:
            raise _failed(self._folder / name, error) from error

    def append(self, name: str, data: bytes) -> None:
        """Write behind the end of a file, made if it is not there."""
        self._write(name, os.O_WRONLY | os.O_CREAT | os.O_APPEND, data)

    def replace(self, name: str, data: bytes) -> None:
        """Write a file from its beginning; what it had is gone."""
        self._write(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, data)

    def truncate(self, name: str, length: int) -> None:
        """Cut a file off behind its first bytes."""
        try:
            os.truncate(self._folder / name, length)
        except OSError as error:
            raise _failed(self._folder / name, error) from error

    def rename(self, old: str, new: str) -> None:
        """Give a file another's name; the other one is gone."""
        try:
            (self._folder / old).replace(self._folder / new)
        except OSError as error:
            raise _failed(self._folder / old, error) from error

    def sync(self, name: str) -> None:
        """Return when the file's content is on the disk."""
        self._sync(self._folder / name)

    def sync_folder(self) -> None:
        """Return when the files' names are on the disk."""
        self._sync(self._folder)

    def _sync(self, path: Path) -> None:
        try:
            handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
        except OSError as error:
            raise _failed(path, error) from error

    def _write(self, name: str, flags: int, data: bytes) -> None:
        try:
            with os.fdopen(open_regular(self._folder / name, flags), "wb") as file:
                file.write(data)
        except OSError as error:
            raise _failed(self._folder / name, error) from error


def open_regular(path: Path, flags: int) -> int:
    """A handle of a regular file, which its owner alone may read if it is made; raises OSError for anything else.

    To open a FIFO would wait for ever for its other end.
    """
    handle = os.open(path, flags | os.O_NONBLOCK, 0o600)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "must be a regular file", path)
    return handle


def _failed(path: Path, error: OSError) -> MediumError:
    return MediumError(f"store {path}: {error.strerror or error}", 0)
