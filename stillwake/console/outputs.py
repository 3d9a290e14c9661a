"""Checks of outputs before a command's work: their paths are locked, and a file is replaced only on request."""

from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any, Final

from contract.errors import OutputError
from contract.results import versions, write_result
from stillwake.console.claims import claim
from stillwake.console.terminal import console, listed

DATASET_SUFFIXES: Final = (".h5", ".hdf5")
"""Endings of a data set's name."""


def check_dataset_name(path: Path) -> None:
    """Raise OutputError if the file's name does not have the ending of a data set."""
    if path.suffix.lower() not in DATASET_SUFFIXES:
        endings = " or ".join(DATASET_SUFFIXES)
        raise OutputError(f"{path}: a data set is an HDF5 file; its name must end in {endings}")


def check_output(
    path: Path, *, overwrite: bool | None, folder: bool = False, occupant: str = "", mark: str = ""
) -> None:
    """Check that an output can be written, and lock its path until the command ends. Raises OutputError if the output
    exists and must not be replaced, or another command writes to the path; StillwakeError if nothing can be written to
    the path.

    Args:
        overwrite: whether the user asked to replace an existing output; None for outputs that are never replaced.
        folder: whether the output is a folder; an empty folder may exist.
        occupant: description of the existing output, for the error message.
        mark: name of a file that every folder of this kind has; a folder without this file is never replaced.
    """
    claim(path, folder=folder)
    if mark and folder and path.is_dir() and any(path.iterdir()) and not (path / mark).exists():
        raise OutputError(f"{path}: holds other files; name another folder")
    if not overwrite and path.exists() and not (folder and not any(path.iterdir())):
        there = occupant or "exists already"
        if overwrite is None:
            raise OutputError(f"{path}: {there}; give another name")
        raise OutputError(f"{path}: {there}; give --overwrite to replace it, or another name")


def check_json(path: Path | None) -> None:
    """Check that a file of figures can be written, and lock its path; an existing file of figures is replaced."""
    if path is not None:
        claim(path)


def check_frames(path: Path | None) -> None:
    """Check that a measurement file of frames can be written, and that the package for its format is installed; lock
    its path."""
    if path is not None:
        from can_bridge.tools.measurement import check_measurement

        claim(path)
        check_measurement(path)


def print_written(path: Path, result: object) -> None:
    """Print that a file was written; for a measurement file also how many frames of each name have no signals in the
    file."""
    skipped = listed(result) if isinstance(result, Counter) else ""
    console.print(f"wrote {path}{f'; frames without signals: {skipped}' if skipped else ''}")


def save_json(path: Path | None, *, figures: Any, facts: Mapping[str, Any], packages: Sequence[str] = ()) -> None:
    """Write figures, the facts on which they depend, the versions of packages and today's date, if a file was given."""
    if path is not None:
        own = {"versions": versions(*packages)} if packages else {}
        write_result(path, figures=figures, facts={**facts, **own}, on=date.today())
