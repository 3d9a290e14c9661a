"""Write the C library of a program: compile it here, prove it against the reference, then write its folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from export.c_host import CController
from export.c_library import c_library, write_c_library
from export.parity import ParityReport, check_lowering
from export.program import ControllerProgram
from export.weights import Array

RECORDED: Final = "recorded.txt"
"""Rows for the example program: pressures, then the action commanded one step before."""


@dataclass(frozen=True, kw_only=True)
class CReport:
    """What the gate measured, and the scratch memory that a caller has to own, in bytes."""

    parity: ParityReport
    workspace_bytes: int


def write_c_release(folder: Path, program: ControllerProgram, windows: Sequence[Array]) -> CReport:
    """Write the library's folder, whole or not at all, with recorded rows beside it for the example program.

    Args:
        windows: consecutive recorded windows (L, S+1).

    Raises:
        ExportError: there is no C compiler, the library disagrees with the reference, or the folder holds
            something else.
        StillwakeError: the folder cannot be written.
    """
    contents = c_library(program)
    controller = CController(program, contents)
    report = CReport(
        parity=check_lowering(program, controller, "C library", windows), workspace_bytes=controller.workspace_bytes
    )
    write_c_library(folder, contents | {RECORDED: recorded_rows(windows).encode()})
    return report


def recorded_rows(windows: Sequence[Array]) -> str:
    """The rows that consecutive windows are made of, one a line, in the digits of float32."""
    rows = np.concatenate([windows[0], *(window[-1:] for window in windows[1:])])
    return "".join(" ".join(f"{value:.9g}" for value in row) + "\n" for row in rows)
