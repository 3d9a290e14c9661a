"""The C library compiled for this machine and called through ctypes: the C side of parity tests and benchmarks."""

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.errors import ExportError
from export.c_library import EXAMPLE
from export.program import ControllerProgram
from export.reference_cost import TERMS
from export.reference_mpc import Solution
from export.weights import FORCES, Array

STANDARD: Final = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion")
OPTIMISED: Final = ("-O3", "-march=native", "-ffp-contract=fast")
"""Contraction to fused multiply-adds changes roundings only; -ffast-math would break them."""
_ALIGNMENT: Final = 64


def host_compiler() -> list[str]:
    """The command that compiles C here: $CC, else cc, gcc or clang, else the `ziglang` package's.

    Raises:
        ExportError: there is none.
    """
    if os.environ.get("CC"):
        return os.environ["CC"].split()
    for name in ("cc", "gcc", "clang"):
        found = shutil.which(name)
        if found:
            return [found]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    raise ExportError("no C compiler: install gcc or clang, or pip install ziglang")


def compile_c(contents: Mapping[str, bytes], output: Path, *, compiler: Sequence[str], flags: Sequence[str]) -> None:
    """Compile and link all C files given, warnings as errors.

    Raises:
        ExportError: the compiler does not take them; the message has its first complaint.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, content in contents.items():
            Path(folder, name).write_bytes(content)
        sources = [name for name in contents if name.endswith(".c")]
        command = [*compiler, *STANDARD, "-Werror", *flags, *sources, "-o", str(output.resolve())]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        except OSError as error:
            raise ExportError(f"{compiler[0]}: {error.strerror or error}") from error
    if done.returncode != 0:
        complaint = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip()[:200])
        raise ExportError(f"{compiler[0]}: {complaint}")


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
        """Compile the library's files; raises ExportError where that fails."""
        library = {name: content for name, content in contents.items() if name != EXAMPLE}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "controller.so")
            compile_c(
                library,
                path,
                compiler=host_compiler() if compiler is None else compiler,
                flags=("-fPIC", "-shared", *flags),
            )
            self._library = ctypes.CDLL(str(path))
        self._library.sw_workspace_bytes.restype = ctypes.c_size_t
        self._input = _input_structure(program)()
        self._output = _output_structure(program)()
        self._library.sw_input_reset(ctypes.byref(self._input))
        self._default_weights = np.array(self._input.weights, dtype=np.float32)
        self._workspace = _aligned(self._library.sw_workspace_bytes())
        self._views = {
            name: np.ctypeslib.as_array(getattr(self._input, name)) for name in ("window", "plan", "free", "weights")
        }

    @property
    def workspace_bytes(self) -> int:
        """Scratch memory that a caller has to own."""
        return int(self._workspace.size)

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> Solution:
        """As `reference_mpc.control_step`; without weights the library's own default applies.

        Raises:
            ExportError: the library says that an input or a result is not finite.
        """
        views = self._views
        views["window"][:], views["plan"][:], views["free"][:] = window, plan, free
        views["weights"][:] = self._default_weights if weights is None else weights
        if self.run() != 0:
            raise ExportError("C controller: an input or a result is not a finite number")
        found = self._output
        return Solution(
            plan=np.array(found.plan, dtype=np.float64),
            forces=np.array(found.forces, dtype=np.float64),
            terms=np.array(found.terms, dtype=np.float64),
            cost=float(found.cost),
        )

    def spoil_workspace(self) -> None:
        """Fill the scratch memory with NaN: no result may depend on what was there."""
        self._workspace[:] = 0xFF

    def run(self) -> int:
        """The bare call on the inputs given last; returns the library's status."""
        return int(
            self._library.sw_control_step(
                ctypes.c_void_p(self._workspace.ctypes.data), ctypes.byref(self._input), ctypes.byref(self._output)
            )
        )


def _input_structure(program: ControllerProgram) -> Any:
    h = program.mpc.horizon
    row = ctypes.c_float * (len(program.sensors) + 1)
    fields = [
        ("window", row * program.window),
        ("plan", ctypes.c_float * h),
        ("free", ctypes.c_float * h),
        ("weights", ctypes.c_float * len(TERMS)),
    ]
    return type("SwInput", (ctypes.Structure,), {"_fields_": fields})


def _output_structure(program: ControllerProgram) -> Any:
    h = program.mpc.horizon
    fields = [
        ("plan", ctypes.c_float * h),
        ("forces", (ctypes.c_float * FORCES) * h),
        ("terms", ctypes.c_float * len(TERMS)),
        ("cost", ctypes.c_float),
    ]
    return type("SwOutput", (ctypes.Structure,), {"_fields_": fields})


def _aligned(size: int) -> np.typing.NDArray[np.uint8]:
    room = np.zeros(size + _ALIGNMENT, dtype=np.uint8)
    start = -room.ctypes.data % _ALIGNMENT
    return room[start : start + size]
