"""The controller's C99 library on this machine: compiled by the host's compiler and called through ctypes.

The library is a folder that `stillwake export --c` writes (`contract.controller.c_folder`). `export` proves a library
with this class before it writes the folder, and `firmware_sim` runs one in the ECU.
"""

import ctypes
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.config.tree import CostWeights
from contract.controller.c_folder import library_sources
from contract.controller.compiler import OPTIMISED, compile_c
from contract.errors import LibraryError

_TERMS: Final = len(fields(CostWeights))
_FORCES: Final = 2
_ALIGNMENT: Final = 64


class HostLibrary:
    """A library compiled and loaded, with the structures that its caller owns.

    Attributes:
        window: (L, S+1), `plan` and `free`: (H,), `weights`: (7,); inputs, written in place. Weights start with the
            library's own.
    """

    def __init__(
        self,
        contents: Mapping[str, bytes],
        *,
        window: int,
        sensors: int,
        horizon: int,
        compiler: Sequence[str],
        flags: Sequence[str] = OPTIMISED,
    ) -> None:
        """Compile the library's files, whose header must have these sizes; raises LibraryError where that fails."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "controller.so")
            compile_c(library_sources(contents), path, compiler=compiler, flags=("-fPIC", "-shared", *flags))
            try:
                self._library = ctypes.CDLL(str(path))
                self._library.sw_workspace_bytes.restype = ctypes.c_size_t
                self._step, reset = self._library.sw_control_step, self._library.sw_input_reset
            except (OSError, AttributeError) as error:
                raise LibraryError(f"the compiled library does not load: {error}") from error
        self._input = _structure(
            "sw_input",
            window=(ctypes.c_float * (sensors + 1)) * window,
            plan=ctypes.c_float * horizon,
            free=ctypes.c_float * horizon,
            weights=ctypes.c_float * _TERMS,
        )
        self._output = _structure(
            "sw_output",
            plan=ctypes.c_float * horizon,
            forces=(ctypes.c_float * _FORCES) * horizon,
            terms=ctypes.c_float * _TERMS,
            cost=ctypes.c_float,
        )
        reset(ctypes.byref(self._input))
        self.window, self.plan, self.free, self.weights = (
            np.ctypeslib.as_array(getattr(self._input, name)) for name in ("window", "plan", "free", "weights")
        )
        self.workspace = _aligned(self._library.sw_workspace_bytes())

    def run(self) -> int:
        """One control step on the inputs as they stand; the library's status, 0 if all is well."""
        return int(
            self._step(
                ctypes.c_void_p(self.workspace.ctypes.data), ctypes.byref(self._input), ctypes.byref(self._output)
            )
        )

    def answer(self, name: str) -> npt.NDArray[np.float64]:
        """A copy of the latest `plan` (H,), `forces` (H, 2), `terms` (7,) or `cost` ()."""
        return np.array(getattr(self._output, name), dtype=np.float64)


def _structure(name: str, **members: Any) -> Any:
    return type(name, (ctypes.Structure,), {"_fields_": list(members.items())})()


def _aligned(size: int) -> npt.NDArray[np.uint8]:
    room = np.zeros(size + _ALIGNMENT, dtype=np.uint8)
    start = -room.ctypes.data % _ALIGNMENT
    return room[start : start + size]
