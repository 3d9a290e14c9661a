"""A saved run as one file to be taken away."""

from pathlib import Path
from typing import IO
from zipfile import ZIP_DEFLATED, ZipFile


def write_zip(folder: Path, file: IO[bytes]) -> None:
    """The folder's files, under its name."""
    with ZipFile(file, "w", compression=ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                archive.write(path, path.relative_to(folder.parent))
