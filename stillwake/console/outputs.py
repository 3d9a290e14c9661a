"""Where a command writes: checked before it works, its own until it ends, and never replaced unless the user asks."""

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any, Final

from contract.errors import OutputError
from contract.results import write_result
from stillwake.console.claims import claim

DATASET_SUFFIXES: Final = (".h5", ".hdf5")
"""How a data set's name ends."""


def check_dataset_name(path: Path) -> None:
    """Refuse a data set that would not be known as one by its name; raises OutputError."""
    if path.suffix.lower() not in DATASET_SUFFIXES:
        endings = " or ".join(DATASET_SUFFIXES)
        raise OutputError(f"{path}: a data set is an HDF5 file; its name must end in {endings}")


def check_output(
    path: Path, *, overwrite: bool | None, folder: bool = False, occupant: str = "", mark: str = ""
) -> None:
    """Refuse a place that cannot be written, or that holds something and is not to be replaced. Raises OutputError if
    something is there, or another command writes there; StillwakeError if nothing can be written there.

    Args:
        overwrite: whether the user asked to replace what is there; None where nothing ever is.
        folder: whether the result is a folder; an empty one counts as free.
        occupant: what is there, in words, for the message.
        mark: a file that a folder of this kind has; one without it is never replaced.
    """
    claim(path, folder=folder)
    if mark and folder and path.is_dir() and any(path.iterdir()) and not (path / mark).exists():
        raise OutputError(f"{path}: there is something else; name another folder")
    if not overwrite and path.exists() and not (folder and not any(path.iterdir())):
        there = occupant or "there is one already"
        if overwrite is None:
            raise OutputError(f"{path}: {there}; give another name")
        raise OutputError(f"{path}: {there}; give --overwrite to replace it, or another name")


def check_json(path: Path | None) -> None:
    """Refuse a place for figures that cannot be written; figures are replaced by newer ones."""
    if path is not None:
        claim(path)


def save_json(path: Path | None, *, figures: Any, facts: Mapping[str, Any]) -> None:
    """Write what was measured today with the facts behind it, if a file was asked for."""
    if path is not None:
        write_result(path, figures=figures, facts=facts, on=date.today())
