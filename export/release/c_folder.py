"""Write the C library of a program: compile it here, prove it against the reference, then write its folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contract.controller.c_folder import RECORDED, rows_text, write_folder
from export.gates.parity import ParityReport, check_lowering
from export.gates.quantisation import QuantisationLimits, QuantisationReport, check_quantisation, compare_answers
from export.int8.activation_ranges import activation_ranges
from export.int8.calibrate import rounded_program
from export.program.controller_program import ControllerProgram
from export.program.weights import Array
from export.to_c.host import CController
from export.to_c.library import c_library
from export.to_onnx.weights import Precision


@dataclass(frozen=True, kw_only=True)
class CReport:
    """What the gates measured.

    Attributes:
        parity: float32 against the reference; None for int8.
        quantisation: int8, integer products included, against the float reference; None for float32.
        workspace_bytes: scratch memory that a caller has to own.
    """

    parity: ParityReport | None
    quantisation: QuantisationReport | None
    workspace_bytes: int


def write_c_release(
    folder: Path,
    program: ControllerProgram,
    *,
    precision: Precision,
    windows: Sequence[Array],
    calibration: Sequence[Array],
    limits: QuantisationLimits | None = None,
) -> CReport:
    """Write the library's folder, whole or not at all, with recorded rows beside it for the example program.

    Args:
        precision: "float32", or "int8" for int8 weights, int16 activations and integer products.
        windows: consecutive recorded windows (L, S+1) that the gates replay.
        calibration: other ones, for int8 rounding and ranges; the same as an int8 ONNX graph is calibrated on.

    Raises:
        LibraryError: there is no C compiler, it does not take the library, or the folder holds something else.
        ExportError: the library is further from the reference than its gate allows.
        StillwakeError: the folder cannot be written.
    """
    if precision == "int8":
        contents = int8_library(program, calibration)
        controller = CController(program, contents)
        quantisation = compare_answers(program, controller.control_step, windows)
        check_quantisation(quantisation, QuantisationLimits() if limits is None else limits, name="int8 C library")
        report = CReport(parity=None, quantisation=quantisation, workspace_bytes=controller.workspace_bytes)
    else:
        contents = c_library(program)
        controller = CController(program, contents)
        parity = check_lowering(program, controller, "C library", windows)
        report = CReport(parity=parity, quantisation=None, workspace_bytes=controller.workspace_bytes)
    write_folder(folder, contents | {RECORDED: recorded_rows(windows).encode()})
    return report


def int8_library(program: ControllerProgram, calibration: Sequence[Array]) -> dict[str, bytes]:
    """The int8 library's files, weights and activation steps calibrated on windows (L, S+1)."""
    rounded = rounded_program(program, calibration)
    return c_library(rounded, activation_ranges(rounded, calibration))


def recorded_rows(windows: Sequence[Array]) -> str:
    """The rows that consecutive windows are made of, one a line, in the digits of float32."""
    return rows_text(np.concatenate([windows[0], *(window[-1:] for window in windows[1:])]))
