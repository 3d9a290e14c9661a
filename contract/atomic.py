"""Files that are either there and whole, or not there at all."""

import errno
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from contract.errors import StillwakeError

_STREAMS = (1, 2)
"""Descriptors of standard output and standard error."""


def leads_to(path: Path) -> Path:
    """The place that a path stands for, through all links: what is written goes there, and the links stay. Raises
    StillwakeError for a link that leads round, or into a folder that is not there."""
    place = Path(os.path.realpath(path))
    if place.is_symlink():
        raise StillwakeError(f"cannot write {path}: {os.strerror(errno.ELOOP)}")
    for link in (path, *path.parents):
        # It may lead to a disk that is not there: what is to be written may be missing, and no folder on the way to it.
        if link.is_symlink() and not link.exists() and (link != path or not place.parent.is_dir()):
            raise StillwakeError(f"cannot write {path}: {link} is a link to {link.readlink()}, which is not there")
    return place


def check_writable(path: Path, *, folder: bool = False) -> None:
    """Find out before the work whether its result can be written: a file is made next to its place and removed again.

    Folders that are missing on the way are not made; the test is then done in the nearest one that is there. Raises
    StillwakeError if `path` is of the other kind or has no name of its own, is where this process prints to, has a
    second name that would keep the old content, or nothing can be written there. `folder` states whether the result is
    a folder; otherwise it is a file.
    """
    if not folder and path.is_dir():
        raise StillwakeError(f"cannot write {path}: it is a directory, must be a file")
    if folder and path.is_file():
        raise StillwakeError(f"cannot write {path}: it is a file, must be a directory")
    if path.name in ("", ".."):
        raise StillwakeError(f"cannot write {path}: name a new folder in it")
    place = leads_to(path)
    if path.exists() and not path.is_dir():
        _check_file(path, path.stat())
    nearest = next(folder for folder in place.parents if os.path.lexists(folder))
    trial = nearest / _temporary(place, "part").name
    try:
        trial.touch()
        trial.unlink()
    except OSError as error:
        raise StillwakeError(f"cannot write {path}: {error.strerror or error}") from error


def _check_file(path: Path, there: os.stat_result) -> None:
    if not stat.S_ISREG(there.st_mode):
        # A device would be replaced, not written to.
        raise StillwakeError(f"cannot write {path}: it is neither a file nor a directory")
    if there.st_nlink > 1:
        raise StillwakeError(
            f"cannot write {path}: the file has {there.st_nlink} names (hard links), and the others would keep the old "
            "one; remove them, or name another file"
        )
    for stream in _STREAMS:
        with suppress(OSError):
            if os.path.samestat(there, os.fstat(stream)):
                raise StillwakeError(f"cannot write {path}: this command prints to it; name another file")


@contextmanager
def replacing(path: Path, *, keep: bool = False) -> Iterator[Path]:
    """Yield a temporary path next to the place that `path` leads to; move it there if the block succeeds, remove it if
    not. Links stay, and lead to what is new; it has the mode of what it replaces.

    With `keep`, the files of a new directory go into an old one, and the others in it stay.

    The folders are made if need be, and removed again if nothing came of it. Works for a file or a directory; an old
    directory is kept until the new one is in its place.
    Raises StillwakeError if the place cannot be written.
    """
    place = leads_to(path)
    temporary, aside = _temporary(place, "part"), _temporary(place, "old")
    made_parent = False
    try:
        missing = [folder for folder in (place.parent, *place.parent.parents) if not folder.exists()]
        made_parent = bool(missing)
        place.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        try:
            keep = keep and place.is_dir()
            for item in sorted(temporary.iterdir()) if keep else ():
                _take_after(item, place / item.name)
                item.replace(place / item.name)
            if temporary.is_dir() and place.is_dir() and not keep:
                # A directory cannot be moved onto another that is not empty.
                place.replace(aside)
            if not keep:
                _take_after(temporary, aside if aside.is_dir() else place)
                temporary.replace(place)
        except BaseException:
            if aside.is_dir() and not place.exists():
                aside.replace(place)
            raise
    except OSError as error:
        raise StillwakeError(f"cannot write {path}: {error.strerror or error}") from error
    except StillwakeError as error:
        # Of a file in a directory: by the name that it was to have.
        named = str(error).replace(str(temporary), str(path))
        if named == str(error):
            raise
        raise type(error)(named) from error
    finally:
        for leftover in (temporary, aside):
            if leftover.is_dir():
                shutil.rmtree(leftover, ignore_errors=True)
            else:
                # Where nothing could be written there is nothing to remove, and the first error is the one to report.
                with suppress(OSError):
                    leftover.unlink()
        if made_parent:
            # Each stays unless it is empty.
            with suppress(OSError):
                for folder in missing:
                    folder.rmdir()


def _take_after(new: Path, old: Path) -> None:
    """Give what is new, and what is in it, the mode and where possible the owner of what it replaces by name."""
    if new.is_symlink() or old.is_symlink() or not old.exists() or old.is_dir() != new.is_dir():
        return
    for item in new.iterdir() if new.is_dir() else ():
        _take_after(item, old / item.name)
    was, is_now = old.stat(), new.stat()
    if (was.st_uid, was.st_gid) != (is_now.st_uid, is_now.st_gid):
        with suppress(PermissionError):
            os.chown(new, was.st_uid, was.st_gid)
    with suppress(PermissionError):  # of a file system without modes
        new.chmod(stat.S_IMODE(was.st_mode))


def _temporary(path: Path, kind: str) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.{kind}")
