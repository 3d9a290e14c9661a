"""The C library compiled for this machine, as a lowering: the C side of gates, parity tests and benchmarks."""

from collections.abc import Mapping, Sequence

from contract.controller.compiler import OPTIMISED, host_compiler
from contract.controller.host_library import HostLibrary
from contract.errors import ExportError
from export.program.controller_program import ControllerProgram
from export.program.weights import Array
from export.reference.mpc import Solution


class CController:
    """A shared library of one program, with the reference's arguments and results."""

    def __init__(
        self,
        program: ControllerProgram,
        contents: Mapping[str, bytes],
        *,
        compiler: Sequence[str] | None = None,
        flags: Sequence[str] = OPTIMISED,
    ) -> None:
        """Compile the library's files; raises LibraryError where that fails."""
        self._library = HostLibrary(
            contents,
            window=program.window,
            sensors=len(program.sensors),
            horizon=program.mpc.horizon,
            compiler=host_compiler() if compiler is None else compiler,
            flags=flags,
        )
        self._default_weights = self._library.weights.copy()

    @property
    def workspace_bytes(self) -> int:
        """Scratch memory that a caller has to own."""
        return int(self._library.workspace.size)

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> Solution:
        """As `reference_mpc.control_step`; without weights the library's own default applies.

        Raises:
            ExportError: the library says that an input or a result is not finite.
        """
        library = self._library
        library.window[:], library.plan[:], library.free[:] = window, plan, free
        library.weights[:] = self._default_weights if weights is None else weights
        if self.run() != 0:
            raise ExportError("C controller: an input or a result is not a finite number")
        plan, forces, terms, cost = (library.answer(name) for name in ("plan", "forces", "terms", "cost"))
        return Solution(plan=plan, forces=forces, terms=terms, cost=float(cost))

    def spoil_workspace(self) -> None:
        """Fill the scratch memory with NaN: no result may depend on what was there."""
        self._library.workspace[:] = 0xFF

    def run(self) -> int:
        """The bare call on the inputs given last; returns the library's status."""
        return self._library.run()
