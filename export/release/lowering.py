"""A program's lowerings, in memory: the ONNX graph and, on request, the C library, of the same numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from contract.arrays import Array
from contract.release.manifest import WeightPrecision
from export.int8.calibrate import rounded_on
from export.int8.layer_inputs import activation_ranges
from export.int8.rounded_program import Program, RoundedProgram, effective, precision_of
from export.program.controller_program import ControllerProgram, program_sha256
from export.to_c.library import c_library
from export.to_onnx.control_step import build_controller


@dataclass(frozen=True, kw_only=True, eq=False)
class Lowered:
    """What stands to be written, once it has passed its gates. `library` is the C library's files by name; None where
    none was asked for."""

    program: Program
    graph: bytes
    library: Mapping[str, bytes] | None = None

    @property
    def effective(self) -> ControllerProgram:
        """What the lowerings compute, as the reference takes it."""
        return effective(self.program)

    @property
    def precision(self) -> WeightPrecision:
        return precision_of(self.program)

    @property
    def program_sha256(self) -> str:
        """The hash as the bundle's manifest and the library's header have it."""
        return program_sha256(self.effective)


def lower(program: Program, *, calibration: Sequence[Array], with_library: bool) -> Lowered:
    """Lower a program. Raises ExportError if the program cannot be lowered; the message names what stands in the way.

    Args:
        calibration: recorded windows (L, S+1) that an int8 library takes its activations' ranges from: those that the
            program was rounded on.
    """
    graph = build_controller(program).SerializeToString()
    return Lowered(program=program, graph=graph, library=library_of(program, calibration) if with_library else None)


def library_of(program: Program, calibration: Sequence[Array]) -> dict[str, bytes]:
    """The C library's files by name; arguments and errors as for `lower`."""
    if isinstance(program, RoundedProgram):
        return c_library(program, activation_ranges(program.program, calibration))
    return c_library(program)


def int8_library(program: ControllerProgram, calibration: Sequence[Array]) -> dict[str, bytes]:
    """The C library of a program that is rounded on these windows."""
    return library_of(rounded_on(program, calibration), calibration)
