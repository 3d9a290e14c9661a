"""Files that are either there and whole, or not there at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from contract.errors import StillwakeError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; move it there if the block succeeds, remove it if not.

    The folders are made if need be, and removed again if nothing came of it. Works for a file or a directory; an old
    directory is kept until the new one is in its place.
    Raises StillwakeError if the place cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    aside = path.with_name(f".{path.name}.{os.getpid()}.old")
    made_parent = False
    try:
        missing = [folder for folder in (path.parent, *path.parent.parents) if not folder.exists()]
        made_parent = bool(missing)
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        try:
            if temporary.is_dir() and path.is_dir():
                # A directory cannot be moved onto another that is not empty.
                path.replace(aside)
            temporary.replace(path)
        except BaseException:
            if aside.is_dir() and not path.exists():
                aside.replace(path)
            raise
    except OSError as error:
        raise StillwakeError(f"cannot write {path}: {error.strerror or error}") from error
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
