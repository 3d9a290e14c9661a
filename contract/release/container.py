"""The files of a bundle in a directory or a zip: read with suspicion, written whole or not at all.

What is read may come from anyone. So names are plain, nothing is followed or unpacked to disk, and every size is
bounded by what is read, not by what the container states.
"""

import errno
import os
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

from contract.atomic import replacing
from contract.errors import BundleContainerError
from contract.printable import is_name, quoted, shown

MAX_FILES: Final = 64
MAX_BYTES: Final = 32 * 2**20
"""Size of all files together: nearly two hundred controllers of the paper's size."""
MAX_BYTES_OF: Final = {"manifest.json": 2**20, "manifest.sig": 2**12}
"""Sizes of files that are read before anything vouches for them."""
MAX_ZIP: Final = MAX_BYTES + 2**20
"""Size of a zip: its files, not compressed, and room for their headers."""
MAX_DIRECTORY: Final = 2**17
"""Size of a zip's directory, whose entries have 46 bytes or more: a comment of the greatest length must pass, and
fewer than three thousand entries are parsed before they are counted."""

_PLAIN_METHODS: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_CHUNK: Final = 2**20


def is_plain_name(name: str) -> bool:
    """Whether this names a file, and no path, in characters that a terminal can show."""
    return is_name(name) and name not in (".", "..") and not any(character in name for character in "/\\:")


def read_files(path: Path) -> dict[str, bytes]:
    """All files of a bundle by name. Raises BundleContainerError if it is neither directory nor whole zip, it is too
    large, or it holds something else than plain files of different names; the message names the entry."""
    try:
        if path.is_dir():
            with closing(_directory(path)) as entries:
                return _collect(path, entries)
        if path.is_file():
            with path.open("rb") as file:
                return _read_zip(path, file)
    except BundleContainerError:
        raise
    except OSError as error:
        raise BundleContainerError(f"bundle {path}: cannot be read ({error.strerror or shown(error)})") from error
    except (
        zipfile.BadZipFile,
        zlib.error,
        struct.error,
        EOFError,
        RuntimeError,
        ValueError,
        ArithmeticError,
        LookupError,
    ) as error:
        raise BundleContainerError(
            f"bundle {path}: cannot be read: truncated, damaged or no zip ({shown(error)})"
        ) from error
    raise BundleContainerError(f"bundle {path}: no such directory or zip")


def write_files(path: Path, contents: Mapping[str, bytes]) -> None:
    """Write a directory, or a zip if the path ends in .zip, in place of what is there. Raises StillwakeError if the
    place cannot be written."""
    with replacing(path) as temporary:
        if path.suffix == ".zip":
            with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
                for name, data in sorted(contents.items()):
                    # A fixed date keeps equal bundles equal byte for byte.
                    archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)
        else:
            temporary.mkdir()
            for name, data in contents.items():
                (temporary / name).write_bytes(data)


class _Entry(NamedTuple):
    """A file that was not read yet; `trouble` is the reason why it must not be; `open` gives its content."""

    name: str
    trouble: str | None
    open: Callable[[], IO[bytes]]


class _DirectoryReader:
    """A zip's file for as long as `zipfile` looks for the central directory, which it takes in one read.

    It believes the size that the zip states, and parses every entry before anyone can count them. The size is judged
    here, where it is used, rather than by a second parser that might find another end record than the library does.
    """

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self._path, self._file = path, file
        self.is_open = False

    def read(self, size: int = -1) -> bytes:
        """At most `MAX_DIRECTORY` bytes until the directory is open; raises BundleContainerError for more."""
        if not self.is_open and not 0 <= size <= MAX_DIRECTORY:
            left = os.fstat(self._file.fileno()).st_size - self._file.tell()
            if left > MAX_DIRECTORY or size > MAX_DIRECTORY:
                raise BundleContainerError(
                    f"bundle {self._path}: its central directory has {size} bytes: at most {MAX_DIRECTORY}"
                )
        return self._file.read(size)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def _read_zip(path: Path, file: IO[bytes]) -> dict[str, bytes]:
    size = os.fstat(file.fileno()).st_size
    if size > MAX_ZIP:
        raise BundleContainerError(f"bundle {path}: has {size} bytes: at most {MAX_ZIP}")
    reader = _DirectoryReader(path, file)
    with zipfile.ZipFile(reader) as archive:
        reader.is_open = True
        return _collect(path, _archive(archive))


def _directory(path: Path) -> Generator[_Entry, None, None]:
    # Not `iterdir`, which lists a directory of millions before the first one is counted.
    with os.scandir(path) as items:
        for item in items:
            trouble = None
            if not is_plain_name(item.name):
                trouble = "is no plain name"
            elif item.is_symlink():
                trouble = "is a symbolic link"
            elif not item.is_file(follow_symlinks=False):
                trouble = "is not a plain file"
            yield _Entry(item.name, trouble, partial(_open_plain, path, item.name))


def _open_plain(path: Path, name: str) -> IO[bytes]:
    """Open what was a plain file a moment ago, and still has to be one: no link is followed, no pipe waited for."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    try:
        file = os.fdopen(os.open(path / name, flags), "rb")
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise BundleContainerError(f"bundle {path}: {name!r} is a symbolic link: must be a plain file") from error
        raise
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise BundleContainerError(f"bundle {path}: {name!r} is not a plain file: must be a plain file")
    return file


def _archive(archive: zipfile.ZipFile) -> Iterator[_Entry]:
    for info in archive.infolist():
        kind = stat.S_IFMT(info.external_attr >> 16)
        trouble = None
        # The library cuts a name at a zero byte and may take another one from an extra field: judge the stored one.
        if not is_plain_name(info.orig_filename) or info.filename != info.orig_filename:
            trouble = "is a path or no plain name"
        elif kind == stat.S_IFLNK:
            trouble = "is a symbolic link"
        elif kind not in (0, stat.S_IFREG):
            trouble = "is not a plain file"
        elif info.compress_type not in _PLAIN_METHODS:
            trouble = f"is compressed by method {info.compress_type}"
        yield _Entry(info.orig_filename, trouble, partial(archive.open, info))


def _collect(path: Path, entries: Iterator[_Entry]) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    left = MAX_BYTES
    for entry in entries:
        if entry.trouble is not None:
            raise BundleContainerError(f"bundle {path}: {quoted(entry.name)} {entry.trouble}: must be a plain file")
        if entry.name in found:
            raise BundleContainerError(f"bundle {path}: {entry.name} is there twice")
        if len(found) == MAX_FILES:
            raise BundleContainerError(f"bundle {path}: more than {MAX_FILES} files or {MAX_BYTES} bytes")
        limit = MAX_BYTES_OF.get(entry.name, MAX_BYTES)
        with entry.open() as file:
            content = _read_at_most(file, min(limit, left) + 1)
        if len(content) > limit:
            raise BundleContainerError(f"bundle {path}: {entry.name} is too large: at most {limit} bytes")
        left -= len(content)
        if left < 0:
            raise BundleContainerError(f"bundle {path}: more than {MAX_FILES} files or {MAX_BYTES} bytes")
        found[entry.name] = content
    return found


def _read_at_most(file: IO[bytes], most: int) -> bytes:
    """A file's content up to that many bytes, in pieces: one great read takes its size from the container."""
    pieces: list[bytes] = []
    while most > 0 and (piece := file.read(min(most, _CHUNK))):
        pieces.append(piece)
        most -= len(piece)
    return pieces[0] if len(pieces) == 1 else b"".join(pieces)
