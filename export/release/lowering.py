"""The lowerings of a program in memory: the ONNX graph and, on request, the C library, with equal numbers."""

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
    """The lowerings of a program. They are written to files after they have passed their gates. `library` has the C
    library's files by name, or is None."""

    program: Program
    graph: bytes
    library: Mapping[str, bytes] | None = None

    @property
    def effective(self) -> ControllerProgram:
        """The program that the lowerings compute; in the gates, the reference computes this program too."""
        return effective(self.program)

    @property
    def precision(self) -> WeightPrecision:
        return precision_of(self.program)

    @property
    def program_sha256(self) -> str:
        """SHA-256 of the program, which the bundle's manifest and the library's header state."""
        return program_sha256(self.effective)


def lower(program: Program, *, calibration: Sequence[Array], with_library: bool) -> Lowered:
    """Lower a program. Raises ExportError if the program cannot be lowered. `calibration` are the recorded windows (L,
    S+1) on which the program was rounded, for an int8 library's activation ranges."""
    graph = build_controller(program).SerializeToString()
    return Lowered(program=program, graph=graph, library=library_of(program, calibration) if with_library else None)


def library_of(program: Program, calibration: Sequence[Array]) -> dict[str, bytes]:
    """Return the C library's files by name; arguments and errors are as in `lower`."""
    if isinstance(program, RoundedProgram):
        return c_library(program, activation_ranges(program.program, calibration))
    return c_library(program)


def int8_library(program: ControllerProgram, calibration: Sequence[Array]) -> dict[str, bytes]:
    """Round a program on recorded windows (L, S+1), and return its int8 C library."""
    return library_of(rounded_on(program, calibration), calibration)
