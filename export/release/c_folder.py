"""The writer of a C library that passed the gates as a folder, with recorded rows for the library's example program."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from contract.arrays import Array
from contract.controller.c_folder import BILL, EXPECTED, RECORDED, rows_text, write_folder
from contract.controller.image_payload import with_layout
from export.release.gated import Gated
from export.to_c.builds import build_files
from export.to_c.library import documents


def write_c_release(
    folder: Path,
    gated: Gated,
    windows: Sequence[Array],
    ecu: Mapping[str, bytes] | None = None,
    bill: Callable[[Mapping[str, bytes]], bytes] | None = None,
) -> None:
    """Write the library's folder, completely or not at all. Raises LibraryError if the folder contains something other
    than a library; StillwakeError if the folder cannot be written.

    Args:
        windows: consecutive recorded windows (L, S+1) of L rows and S sensors, whose rows are written to the folder.
        ecu: files of the ECU around the control step, and the ECU's documents.
        bill: computes the bill of materials from all files of the folder.
    """
    assert gated.lowered.library is not None
    assert gated.library is not None
    recorded = {RECORDED: recorded_rows(windows).encode(), EXPECTED: rows_text(gated.library.replayed).encode()}
    library = with_layout({**gated.lowered.library, **({} if ecu is None else ecu)})
    contents = {**library, **recorded, **documents(library), **build_files(library)}
    write_folder(folder, contents if bill is None else {**contents, BILL: bill(contents)})


def recorded_rows(windows: Sequence[Array]) -> str:
    """Return the rows of consecutive windows as text, one row per line, with the digits of float32."""
    return rows_text(rows_of(windows))


def rows_of(windows: Sequence[Array]) -> Array:
    """Return the n different rows of consecutive windows (L, S+1), as an array (n, S+1)."""
    return np.concatenate([windows[0], *(window[-1:] for window in windows[1:])])
