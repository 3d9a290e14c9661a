"""The controller's C99 library on this machine: the host's compiler, and the compiled library called through ctypes.

The library is a folder that `stillwake export --c` writes; `stillwake.h` in it describes one control step. `export`
proves a library with what stands here before it writes the folder, and `firmware_sim` runs one in the ECU.
"""

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.config.tree import CostWeights
from contract.errors import LibraryError

EXAMPLE: Final = "main.c"
"""Runs a control step from recorded numbers on a host; not part of the library."""
STANDARD: Final = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion")
OPTIMISED: Final = ("-O3", "-march=native", "-ffp-contract=fast")
"""Contraction to fused multiply-adds changes roundings only; -ffast-math would break them."""
_TERMS: Final = len(fields(CostWeights))
_FORCES: Final = 2
_ALIGNMENT: Final = 64


def host_compiler() -> list[str]:
    """The command that compiles C here: $CC, else cc, gcc or clang, else the `ziglang` package's.

    Raises:
        LibraryError: there is none.
    """
    if os.environ.get("CC"):
        return os.environ["CC"].split()
    for name in ("cc", "gcc", "clang"):
        found = shutil.which(name)
        if found:
            return [found]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    raise LibraryError("no C compiler: install gcc or clang, or pip install ziglang")


def compiler_version(compiler: Sequence[str]) -> str:
    """The first line of what the compiler says about itself; raises LibraryError if it does not run."""
    return next(iter(_run([*compiler, "--version"], None).stdout.splitlines()), compiler[0]).strip()


def compile_c(contents: Mapping[str, bytes], output: Path, *, compiler: Sequence[str], flags: Sequence[str]) -> None:
    """Compile and link all C files given, warnings as errors.

    Raises:
        LibraryError: the compiler does not take them; the message has its first complaint.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, content in contents.items():
            Path(folder, name).write_bytes(content)
        sources = [name for name in contents if name.endswith(".c")]
        done = _run([*compiler, *STANDARD, "-Werror", *flags, *sources, "-o", str(output.resolve())], folder)
    if done.returncode != 0:
        said = done.stderr.strip().splitlines() or [f"ended with status {done.returncode}"]
        raise LibraryError(f"{compiler[0]}: {next((line for line in said if 'error' in line), said[0][:200])}")


def _run(command: list[str], folder: str | None) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    except OSError as error:
        raise LibraryError(f"{command[0]}: {error.strerror or error}") from error


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
        sources = {name: content for name, content in contents.items() if name != EXAMPLE}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "controller.so")
            compile_c(sources, path, compiler=compiler, flags=("-fPIC", "-shared", *flags))
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
