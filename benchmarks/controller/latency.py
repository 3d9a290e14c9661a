"""Latency of one control step: the paper's method in eager PyTorch, the ONNX graphs and the C library, in one run.

    python -m benchmarks controller [--json FILE]

Each implementation runs on one thread. The implementations run in turn, so that a disturbance of the machine affects
all of them. The figures are medians and minima of wall time. The weights are random and the networks have the release's
sizes, because the time depends only on the sizes.
"""

import time
from functools import partial
from statistics import median
from typing import Any, Final

import torch

from benchmarks.common.command_line import JsonFile, report, track
from benchmarks.controller import tables
from benchmarks.controller.eager import EagerController
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.results import versions
from contract.runtime.onnx_session import OnnxController
from ecu.in_c.compiler import OPTIMISED, compiler_version, host_compiler
from ecu.in_c.host_library import CController
from examples.random_programs import random_program
from export.gates import control_cases
from export.int8 import Program, rounded_to_nearest
from export.program.controller_program import random_windows
from export.to_c.library import c_library, int8_library
from export.to_onnx.control_step import build_controller

_REPEATS: Final = 300
_WIDTHS: Final[dict[str, Any]] = {"dynamics_width": 64, "decoder_width": 32}
_PLAN: Final[dict[str, Any]] = {"horizon": 25, "iterations": 2}


def main(json_file: JsonFile = None) -> None:
    """Time the control step and print a table."""
    torch.set_num_threads(1)
    program = random_program(0, model=ModelConfig(**_WIDTHS), mpc=MpcConfig(**_PLAN))
    (case,) = control_cases(program, count=1)
    lowered: dict[str, Program] = {"float32": program, "int8": rounded_to_nearest(program)}
    graphs = {name: build_controller(of).SerializeToString() for name, of in lowered.items()}
    compiler = host_compiler()
    libraries = c_library(program), int8_library(program, random_windows(program, 20))
    c, c_int8 = (CController(library, program.sizes, compiler=compiler) for library in libraries)
    controllers: dict[str, Any] = {
        "eager_ms": EagerController(program, torch.float32),
        "onnx_ms": OnnxController(graphs["float32"], program.sizes),
        "onnx_int8_ms": OnnxController(graphs["int8"], program.sizes),
        "c_ms": c,
        "c_int8_ms": c_int8,
    }
    steps = {name: partial(one.control_step, case.window, case.plan, case.free) for name, one in controllers.items()}
    for step in steps.values():
        step()  # warms up caches and allocators
    times: dict[str, list[float]] = {name: [] for name in steps}
    for i in track(range(_REPEATS), "control steps", "steps"):
        for name, step in steps.items():
            # A step in eager PyTorch takes about as long as ten steps of another implementation, so fewer are timed.
            if name != "eager_ms" or i % 5 == 0:
                began = time.perf_counter()
                step()
                times[name].append((time.perf_counter() - began) * 1e3)

    figures: dict[str, Any] = {name: median(values) for name, values in times.items()}
    figures["min"] = {name: min(values) for name, values in times.items()}
    figures["onnx_bytes"], figures["onnx_int8_bytes"] = len(graphs["float32"]), len(graphs["int8"])
    figures["c_workspace_bytes"], figures["c_int8_workspace_bytes"] = c.workspace_bytes, c_int8.workspace_bytes
    settings = {**_WIDTHS, **_PLAN, "repeats": _REPEATS, "threads": 1, "c_flags": " ".join(OPTIMISED)}
    used = versions("torch", "onnxruntime", "numpy") | {"c_compiler": compiler_version(compiler)}
    report(json_file, figures, {"settings": settings, "versions": used}, tables.latency)
