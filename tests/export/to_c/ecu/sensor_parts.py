"""The sensor check of the ECU in C, compiled for this host and called: its estimator, or answers in place of one."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import cffi
import numpy as np

from contract.arrays import Array
from contract.config.tree import Config
from contract.controller.estimator import EstimatorNetwork, Hypotheses
from contract.release.bundle import load
from contract.shipped import BUNDLE
from export.int8.activation_ranges import activation_ranges
from export.int8.calibrate import rounded_on
from export.program.random_program import random_program, random_windows
from export.to_c.library import c_library
from firmware_sim.in_c.c_settings import HEADER, ecu_settings
from firmware_sim.in_c.compiler import host_compiler
from stillwake.parts.c_samples import MODEL, MPC
from tests.export.to_c.ecu.wire_parts import declarations

WINDOW: Final = 32
SANITISED: Final = ("-O1", "-ffp-contract=off", "-fsanitize=undefined,float-cast-overflow", "-fno-sanitize-recover=all")
GIVEN: Final = """
#include "sw_ecu_parts.h"
double given[SW_HYPOTHESES][SW_SENSORS];
int first_row;
void sw_estimate(sw_estimator_work *work, const double window[SW_WINDOW][SW_COLUMNS], int first)
{
    (void)window;
    first_row = first;
    for (int h = 0; h < SW_HYPOTHESES; h++) {
        for (int s = 0; s < SW_SENSORS; s++) work->estimates[h][s] = given[h][s];
    }
}
"""
"""An estimator whose answers are what the test writes into `given`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorParts:
    """One build.

    Attributes:
        lib: the functions of `sw_ecu_parts.h`.
        ffi: makes their arguments.
    """

    lib: Any
    ffi: Any

    def estimates(self, window: Array, rows: int = WINDOW) -> Array:
        """(S + P, S) by `sw_estimate`."""
        work = self.ffi.new("sw_estimator_work *")
        self.lib.sw_estimate(work, window.tolist(), WINDOW - rows)
        return self.array(work.estimates).reshape(-1, 4).copy()

    def array(self, member: Any, dtype: Any = np.float64) -> Array:
        """A view of a member."""
        return np.frombuffer(self.ffi.buffer(member), dtype=dtype)


def network(seed: int = 0, width: int = 64) -> EstimatorNetwork:
    """A random one of the shipped one's shape, whose layers keep the size of what they are given."""
    rng = np.random.default_rng(seed)
    sizes = (WINDOW * 5 + 4, width, width, 4)
    layers = [(rng.normal(size=(b, a)) * np.sqrt(2 / a), rng.normal(size=b) / 4) for a, b in pairwise(sizes)]
    return EstimatorNetwork(
        window=WINDOW,
        mean=np.array([-0.29, -0.36, -0.41, -0.37, 0.0]),
        std=np.array([0.18, 0.22, 0.24, 0.27, 0.03]),
        layers=layers,
    )


def by_hypothesis(estimates: Array) -> Array:
    """(S + P, S) of a graph's estimates (V, S)."""
    found: Array = estimates[Hypotheses.of(4).view, np.arange(4)]
    return found


@cache
def headers() -> dict[str, bytes]:
    """Of a small int8 library, and of the ECU with the shipped release's figures."""
    program = random_program(0, model=MODEL, mpc=MPC)
    windows = random_windows(program, 10)
    rounded = rounded_on(program, windows)
    library = c_library(rounded, activation_ranges(rounded.program, windows))
    found = library | {item.name: item.read_bytes() for item in files("export.to_c").joinpath("sources/ecu").iterdir()}
    return {name: text for name, text in found.items() if name.endswith(".h")} | {
        HEADER: ecu_settings(load(BUNDLE), Config())
    }


def built(
    generated: Mapping[str, bytes],
    names: Sequence[str],
    folder: Path,
    compile_c: Callable[..., None],
    flags: Sequence[str] = SANITISED,
    extra: str = "",
) -> SensorParts:
    """These files of the ECU, with generated ones and more functions, whose declarations follow the ECU's.

    With GCC, what UBSan finds ends the test's process.
    """
    compiler = ["gcc"] if shutil.which("gcc") else host_compiler()
    used = [flag for flag in flags if compiler == ["gcc"] or "sanitize" not in flag]
    root = files("export.to_c").joinpath("sources/ecu")
    contents = headers() | dict(generated)
    path = folder / "sensors.so"
    compile_c(
        contents | {name: root.joinpath(name).read_bytes() for name in names},
        path,
        compiler=compiler,
        flags=["-shared", "-fPIC", "-g1", *used],
    )
    ffi = cffi.FFI()
    text = {name: content for name, content in contents.items() if name.endswith(".h")}
    ffi.cdef(declarations(text, folder, compiler) + extra)
    return SensorParts(lib=ffi.dlopen(str(path)), ffi=ffi)
