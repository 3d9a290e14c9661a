"""The functions that write a file or folder completely or not at all."""

import errno
import os
import re
import shutil
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from contract.errors import StillwakeError

_LEFT: Final = re.compile(r"\..+\.(lock|\d+\.(part|old))", re.DOTALL)


def leads_to(path: Path) -> Path:
    """Follow all links in a path, and return the path to which they lead. Writing a file to the returned path does not
    replace a link. Raises StillwakeError for a cyclic link, or a link into a missing folder."""
    place = Path(os.path.realpath(path))
    if place.is_symlink():
        raise StillwakeError(f"cannot write {path}: {os.strerror(errno.ELOOP)}")
    for link in (path, *path.parents):
        # A link to a missing folder is an error: it may lead to a disk that is not mounted. Only the last name of the
        # path may be a link to a missing file, which is then created if its folder exists.
        if link.is_symlink() and not link.exists() and (link != path or not place.parent.is_dir()):
            raise StillwakeError(f"cannot write {path}: {link} is a link to {link.readlink()}, which does not exist")
    return place


def check_writable(path: Path, *, folder: bool = False) -> None:
    """Check before a computation that its result, a file or a `folder`, can be written to `path`. A test file is
    created in the nearest existing folder and removed. Raises StillwakeError if `path` is of the other kind, ends in
    `..`, is a device, is printed to by this process, has another hard link with the old content, or is not writable."""
    if not folder and path.is_dir():
        raise StillwakeError(f"cannot write {path}: it is a directory, must be a file")
    if folder and path.is_file():
        raise StillwakeError(f"cannot write {path}: it is a file, must be a directory")
    if path.name in ("", ".."):
        raise StillwakeError(f"cannot write {path}: name a new folder in this directory")
    place = leads_to(path)
    if path.exists() and not path.is_dir():
        there = path.stat()
        if not stat.S_ISREG(there.st_mode):
            # Writing would replace a device, such as /dev/null, by a file.
            raise StillwakeError(f"cannot write {path}: it is neither a file nor a directory")
        if there.st_nlink > 1:
            raise StillwakeError(
                f"cannot write {path}: the file has {there.st_nlink} names (hard links), and the other names would "
                "keep the old content; remove the other names, or name another file"
            )
        for stream in (1, 2):  # standard output and standard error
            with suppress(OSError):
                if os.path.samestat(there, os.fstat(stream)):
                    raise StillwakeError(f"cannot write {path}: this command prints to it; name another file")
    nearest = next(folder for folder in place.parents if os.path.lexists(folder))
    trial = nearest / _temporary(place, "part").name
    try:
        trial.touch()
        trial.unlink()
    except OSError as error:
        raise StillwakeError(f"cannot write {path}: {error.strerror or error}") from error


@contextmanager
def replacing(path: Path, *, keep: bool = False) -> Iterator[Path]:
    """Yield a temporary path, at which the `with` block writes a file or a directory. If the block succeeds, this file
    or directory replaces the target, to which all links in `path` lead; otherwise it is removed. The new content gets
    the permissions of the old content. An old directory remains until the new directory has replaced it. With `keep`,
    the new files are moved into the old directory, whose other files remain. Missing parent folders are created, and
    removed again if the block fails. Raises StillwakeError if the target cannot be written."""
    place = leads_to(path)
    temporary, aside = _temporary(place, "part"), _temporary(place, "old")
    missing: list[Path] = []
    try:
        missing = [folder for folder in (place.parent, *place.parent.parents) if not folder.exists()]
        place.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        try:
            keep = keep and place.is_dir()
            for item in sorted(temporary.iterdir()) if keep else ():
                _take_after(item, place / item.name)
                item.replace(place / item.name)
            if not keep:
                _take_after(temporary, place)
                if temporary.is_dir() and place.is_dir():
                    # A directory cannot be moved onto a directory that is not empty.
                    place.replace(aside)
                temporary.replace(place)
        except BaseException:
            if aside.is_dir() and not place.exists():
                aside.replace(place)
            raise
    except OSError as error:
        raise StillwakeError(f"cannot write {path}: {error.strerror or error}") from error
    except StillwakeError as error:
        # The error message must state the final path and not the temporary path.
        error.args = (str(error).replace(str(temporary), str(path)),)
        raise
    finally:
        for leftover in (temporary, aside):
            # `rmtree` removes a folder, `unlink` a file. An error here must not replace the error that is being raised.
            shutil.rmtree(leftover, ignore_errors=True)
            with suppress(OSError):
                leftover.unlink()
        # `rmdir` fails for a folder that is not empty; such a folder remains.
        with suppress(OSError):
            for folder in missing:
                folder.rmdir()


def write_files(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write or replace a folder with files by name, completely or not at all. A name may include one subfolder. Raises
    StillwakeError if the folder cannot be written."""
    with replacing(folder) as temporary:
        temporary.mkdir()
        for name, content in contents.items():
            (temporary / name).parent.mkdir(exist_ok=True)
            (temporary / name).write_bytes(content)


def _take_after(new: Path, old: Path) -> None:
    """Give the new file the mode and, if possible, the owner of the old file; in a folder, do so for each old name."""
    if new.is_symlink() or old.is_symlink() or not old.exists() or old.is_dir() != new.is_dir():
        return
    for item in new.iterdir() if new.is_dir() else ():
        _take_after(item, old / item.name)
    was, is_now = old.stat(), new.stat()
    if (was.st_uid, was.st_gid) != (is_now.st_uid, is_now.st_gid):
        with suppress(PermissionError):
            os.chown(new, was.st_uid, was.st_gid)
    with suppress(PermissionError):  # raised by a file system that has no modes
        new.chmod(stat.S_IMODE(was.st_mode))


def names_in(folder: Path) -> set[str]:
    """Return the names in a folder, without the hidden files that a killed process may leave: the lock files
    `.NAME.lock`, and this module's temporary files `.NAME.PID.part` and `.NAME.PID.old`."""
    return {item.name for item in folder.iterdir() if not _LEFT.fullmatch(item.name)}


def _temporary(path: Path, kind: str) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.{kind}")
