"""The controller's C99 library on this machine: compiled by this machine's compiler and called through ctypes.

The library is a folder that `stillwake export --c` writes (`contract.controller.c_folder`). The same class runs it for
the checks of `export` and for the ECU of `firmware_sim`.
"""

import ctypes
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from contract.arrays import Array
from contract.controller.c_folder import PROGRAM_SETTINGS, ProgramSettings, library_sources, read_sources
from contract.controller.interface import FORCES, REFUSALS, TERMS, ControllerError, ControlStep, Sizes
from contract.errors import LibraryError
from contract.release.checks import Bundle, dbc_sha256
from contract.runtime.copies import NeverCopied
from ecu.in_c.compiler import EXACT, OPTIMISED, compile_c, compiler_version, host_compiler

_OK: Final = 0
_ALIGNMENT: Final = 64


class CController(NeverCopied):
    """A compiled and loaded library, with the structures and the scratch memory that a caller has to provide, and a
    description of compiler and flags. Raises LibraryError if no compiler exists, or the compiler rejects the files.

    Args:
        contents: the library's files by name.
        sizes: sizes in the library's header, which give the layout of the structures.
        compiler: command that compiles C; None finds a compiler on this machine.
    """

    INSTEAD: ClassVar = "it is a loaded library; build another library of the same sources"

    def __init__(
        self,
        contents: Mapping[str, bytes],
        sizes: Sizes,
        *,
        compiler: Sequence[str] | None = None,
        flags: Sequence[str] = OPTIMISED,
    ) -> None:
        command = host_compiler() if compiler is None else list(compiler)
        self._made_of = contents, sizes, command
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "controller.so")
            compile_c(library_sources(contents), path, compiler=command, flags=("-fPIC", "-shared", *flags))
            try:
                self._library = ctypes.CDLL(str(path))
                self._library.sw_workspace_bytes.restype = ctypes.c_size_t
                self._step, reset = self._library.sw_control_step, self._library.sw_input_reset
            except (OSError, AttributeError) as error:
                raise LibraryError(f"the compiled library does not load: {error}") from error
        # Older versions of the library do not have this function, which checks the arithmetic.
        if (looks := getattr(self._library, "sw_arithmetic", None)) is not None and (status := looks()) != _OK:
            raise LibraryError(f"the compiled library does not run: {REFUSALS[status]} ({' '.join(flags)})")
        self.description = f"{compiler_version(command)}, {' '.join(flags)}"
        horizon, number = sizes.horizon, ctypes.c_float
        steps, terms = number * horizon, number * len(TERMS)
        window = (number * (sizes.sensors + 1)) * sizes.window
        self._input = _structure(
            "sw_input", window=window, plan=steps, free=steps, weights=terms, speed=number, limit=number
        )
        self._output = _structure("sw_output", plan=steps, forces=(number * FORCES) * horizon, terms=terms, cost=number)
        reset(ctypes.byref(self._input))
        self._window, self._plan, self._free, self._weights = (
            np.ctypeslib.as_array(getattr(self._input, name)) for name in ("window", "plan", "free", "weights")
        )
        self._default_weights, self._default_limit = self._weights.copy(), self._input.limit
        size = self._library.sw_workspace_bytes()
        room = np.zeros(size + _ALIGNMENT, dtype=np.uint8)
        self._workspace = room[-room.ctypes.data % _ALIGNMENT :][:size]

    @property
    def workspace_bytes(self) -> int:
        """Size of the scratch memory that a caller has to provide, in bytes."""
        return int(self._workspace.size)

    def warm_up(self, steps: int) -> None:
        """Run control steps on zeros, so that code and weights are already in memory when the first real step runs."""
        window, plan, free = (np.zeros(array.shape) for array in (self._window, self._plan, self._free))
        for _ in range(steps):
            self.control_step(window, plan, free)

    def control_step(
        self,
        window: Array,
        plan: Array,
        free: Array,
        weights: Array | None = None,
        speed: float = 1.0,
        limit: float | None = None,
    ) -> ControlStep:
        """Compute one control step in float32; raise ControllerError if an input or a result is not finite."""
        self._window[:], self._plan[:], self._free[:] = window, plan, free
        self._weights[:] = self._default_weights if weights is None else weights
        self._input.speed = speed
        self._input.limit = self._default_limit if limit is None else limit
        workspace = ctypes.c_void_p(self._workspace.ctypes.data)
        self._check(self._step(workspace, ctypes.byref(self._input), ctypes.byref(self._output)))
        found = self._output
        arrays = {name: np.array(getattr(found, name), dtype=np.float64) for name in ("plan", "forces", "terms")}
        return ControlStep(**arrays, cost=float(found.cost))

    def known_answer(self) -> tuple[float, float]:
        """Build the sources again, without fused operations, and return the first action and the cost of the control
        step in `sw_known_answer.c`. Raises LibraryError if the build fails, ControllerError if the step fails."""
        contents, sizes, command = self._made_of
        exact = CController(contents, sizes, compiler=command, flags=EXACT)
        workspace, given, found = ctypes.c_void_p(exact._workspace.ctypes.data), exact._input, exact._output
        self._check(exact._library.sw_known_answer(workspace, ctypes.byref(given), ctypes.byref(found)))
        return found.plan[0], found.cost

    @staticmethod
    def _check(status: int) -> None:
        if status != _OK:
            raise ControllerError(f"the C library returned status {status}: {REFUSALS[status]}")


def _structure(name: str, **members: Any) -> Any:
    return type(name, (ctypes.Structure,), {"_fields_": list(members.items())})()


def open_library(
    folder: Path, bundle: Bundle, *, compiler: Sequence[str] | None = None, flags: Sequence[str] = OPTIMISED
) -> CController:
    """Compile a folder that `stillwake export --c` wrote; the result runs instead of the bundle's `controller.onnx`.

    A hash of the verified release's program in the library's header protects against mix-ups, not against attacks: the
    sources are unsigned, and are compiled and run as they are. Raises LibraryError if the folder holds no library or
    another controller's library, if there is no compiler, or if the compiler rejects the sources.
    """
    sources = read_sources(folder)
    precision = check_program(folder, sources, bundle)
    try:
        controller = CController(sources, bundle.manifest.sizes, compiler=compiler, flags=flags)
    except LibraryError as error:
        raise LibraryError(f"library {folder}: {error}") from error
    controller.description = f"C99 {precision}, {controller.description}"
    return controller


def check_program(folder: Path, sources: dict[str, bytes], bundle: Bundle) -> str:
    """Return the library's precision; raise LibraryError if its header does not match the bundle's controller."""
    manifest = bundle.manifest
    try:
        header = ProgramSettings.of(sources)
        program, precision = header.text("SW_PROGRAM_SHA256"), header.text("SW_PRECISION")
        # The hash does not cover the sizes in the header, which the caller's structures use.
        sizes = [header.text(name) for name in ("SW_WINDOW", "SW_HORIZON", "SW_SENSOR_NAMES", "SW_SENSORS")]
        dbc = header.text("SW_DBC_SHA256")
    except (LibraryError, UnicodeDecodeError) as error:
        raise LibraryError(f"library {folder}: {error}") from error
    if program != (own := manifest.program_sha256):
        wrong = f"it computes program {program[:12]}, but bundle {manifest.name!r} has program {own[:12]}"
        raise LibraryError(f"library {folder}: {wrong}; write library and bundle with one `stillwake export --c`")
    expected = [manifest.window, manifest.mpc.horizon, " ".join(manifest.sensors), len(manifest.sensors)]
    if sizes != [str(size) for size in expected]:
        raise LibraryError(f"library {folder}: {PROGRAM_SETTINGS} was altered: its sizes are not the program's sizes")
    if dbc != dbc_sha256():
        raise LibraryError(f"library {folder}: it was built for another stillwake.dbc")
    return precision
