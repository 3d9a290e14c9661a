"""The gates (checks) for a program's lowerings: the ONNX graph and, on request, the C library. Lowerings are built in
memory; only lowerings that have passed every gate are written to files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from contract.arrays import Array
from contract.controller.interface import CompileLibrary
from contract.release.manifest import WeightPrecision
from contract.runtime.onnx_session import OnnxController
from export import gates
from export.gates import Answer, Figures, check_lowering, check_quantisation
from export.int8 import Program, RoundedProgram, effective, precision_of
from export.program.controller_program import ControllerProgram, program_sha256
from export.reference.mpc import control_step
from export.to_c.library import c_library, replay, with_answer
from export.to_onnx.control_step import build_controller


@dataclass(frozen=True, kw_only=True, eq=False)
class Lowered:
    """The lowerings of a program. `library` has the C library's files by name, or is None."""

    program: Program
    graph: bytes
    library: Mapping[str, bytes] | None = None

    @property
    def effective(self) -> ControllerProgram:
        """The program that the lowerings compute, with dequantised weights if the weights are int8."""
        return effective(self.program)

    @property
    def precision(self) -> WeightPrecision:
        return precision_of(self.program)

    @property
    def program_sha256(self) -> str:
        """SHA-256 of the program, which the bundle's manifest and the library's header state."""
        return program_sha256(self.effective)


def lower(program: Program, *, calibration: Sequence[Array], with_library: bool) -> Lowered:
    """Convert a program to ONNX and, on request, to C. Raises ExportError if this is impossible. `calibration` has the
    recorded windows (L, S+1) with which the program was rounded; they also give an int8 library's activation ranges."""
    graph = build_controller(program).SerializeToString()
    return Lowered(program=program, graph=graph, library=c_library(program, calibration) if with_library else None)


@dataclass(frozen=True, kw_only=True)
class GraphReport:
    """The results of the ONNX graph in its gates. The manifest's provenance has these results under `export`.
    `controller_bytes` is the size of `controller.onnx`. `parity` has the differences between graph and reference.
    `quantisation` has the differences between int8 and float weights, or is None for a float release."""

    controller_bytes: int
    parity: Figures
    quantisation: Figures | None


@dataclass(frozen=True, kw_only=True, eq=False)
class LibraryReport:
    """The results of the C library in its gates. `parity` has the differences between a float32 library and the
    reference, and `quantisation` the differences between an int8 library and the reference with float weights.
    `workspace_bytes` is the size of the scratch memory that the caller provides. `replayed` (n, 4) are the expected
    answers of the example program to n windows: action, mean Cd and Cl, cost. `known_answer` has the action and the
    cost that a build must compute in its self-test when it starts."""

    parity: Figures | None
    quantisation: Figures | None
    workspace_bytes: int
    replayed: Array
    known_answer: tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Gated:
    """The lowerings and their results in the gates; `library` is None if there is no C library."""

    lowered: Lowered
    graph: GraphReport
    library: LibraryReport | None


def gate(
    lowered: Lowered,
    windows: Sequence[Array],
    limits: Mapping[str, float] = gates.QUANTISATION_LIMITS,
    *,
    compiled: CompileLibrary | None = None,
) -> Gated:
    """Run every lowering through its gates, with consecutive recorded windows (L, S+1) of L rows and S sensors.
    `compiled` compiles the C library, and must be given if there is a C library. Raises ExportError, with difference
    and limit, if a lowering differs from the reference by more than its gate allows; LibraryError if the C library does
    not compile."""
    program = lowered.effective
    rounded = lowered.program if isinstance(lowered.program, RoundedProgram) else None
    # The exact control steps, which take longest to compute, are computed once for both lowerings.
    exact = [] if rounded is None else gates.exact_answers(rounded.source, windows)

    def quantisation(answer: Answer, name: str) -> Figures | None:
        if rounded is None:
            return None
        figures = gates.compare_answers(rounded.source, answer, windows, exact)
        check_quantisation(figures, limits, name=name)
        return figures

    by_weights = quantisation(partial(control_step, program), "int8 weights")
    parity = check_lowering(program, OnnxController(lowered.graph, program.sizes), "ONNX graph", windows)
    graph = GraphReport(controller_bytes=len(lowered.graph), parity=parity, quantisation=by_weights)
    if lowered.library is None:
        return Gated(lowered=lowered, graph=graph, library=None)
    assert compiled is not None
    controller = compiled(lowered.library, program.sizes)
    library = LibraryReport(
        parity=check_lowering(program, controller, "C library", windows) if rounded is None else None,
        quantisation=quantisation(controller.control_step, "int8 C library"),
        workspace_bytes=controller.workspace_bytes,
        replayed=replay(controller, windows, program.mpc.horizon),
        known_answer=controller.known_answer(),
    )
    known = replace(lowered, library=with_answer(lowered.library, library.known_answer))
    return Gated(lowered=known, graph=graph, library=library)
