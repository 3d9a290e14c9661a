"""Files that are either there and whole, or not there at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from contract.errors import StillwakeError


def check_writable(path: Path, *, folder: bool = False) -> None:
    """Find out before the work whether its result can be written: a file is made next to `path` and removed again.

    Folders that are missing on the way are not made; the test is then done in the nearest one that is there. Raises
    StillwakeError if `path` is of the other kind or has no name of its own, or nothing can be written there. `folder`
    states whether the result is a folder; otherwise it is a file.
    """
    if not folder and path.is_dir():
        raise StillwakeError(f"cannot write {path}: it is a directory, must be a file")
    if folder and path.is_file():
        raise StillwakeError(f"cannot write {path}: it is a file, must be a directory")
    if path.exists() and not (path.is_dir() or path.is_file()):
        # A device would be replaced, not written to.
        raise StillwakeError(f"cannot write {path}: it is neither a file nor a directory")
    if path.name in ("", ".."):
        raise StillwakeError(f"cannot write {path}: name a new folder in it")
    place = path.parent
    while not os.path.lexists(place) and place != place.parent:
        place = place.parent
    trial = place / _temporary(path, "part").name
    try:
        trial.touch()
        trial.unlink()
    except OSError as error:
        raise StillwakeError(f"cannot write {path}: {error.strerror or error}") from error


@contextmanager
def replacing(path: Path, *, keep: bool = False) -> Iterator[Path]:
    """Yield a temporary path next to `path`; move it there if the block succeeds, remove it if not.

    With `keep`, the files of a new directory go into an old one, and the others in it stay.

    The folders are made if need be, and removed again if nothing came of it. Works for a file or a directory; an old
    directory is kept until the new one is in its place.
    Raises StillwakeError if the place cannot be written.
    """
    temporary, aside = _temporary(path, "part"), _temporary(path, "old")
    made_parent = False
    try:
        missing = [folder for folder in (path.parent, *path.parent.parents) if not folder.exists()]
        made_parent = bool(missing)
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        try:
            keep = keep and path.is_dir()
            for item in sorted(temporary.iterdir()) if keep else ():
                item.replace(path / item.name)
            if temporary.is_dir() and path.is_dir() and not keep:
                # A directory cannot be moved onto another that is not empty.
                path.replace(aside)
            if not keep:
                temporary.replace(path)
        except BaseException:
            if aside.is_dir() and not path.exists():
                aside.replace(path)
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


def _temporary(path: Path, kind: str) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.{kind}")
