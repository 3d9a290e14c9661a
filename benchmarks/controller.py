"""Latency of one control step: the paper's recipe in eager PyTorch, the ONNX graphs and the C library, in one run.

    python benchmarks/controller.py [--json FILE] [--repeats N]

One thread each, interleaved, so that all meet the same disturbances; medians and minima of wall time. Weights
are random at the paper's sizes (our time does not depend on them); other sizes are options. Where CasADi is installed
(`pip install "stillwake[bench]"`), its solvers get the same problem, from the same shifted plan, and the costs that all
reach are compared.
"""

import importlib.util
import json
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from contract.atomic import replacing
from contract.config import ModelConfig, MpcConfig
from contract.host_library import OPTIMISED, compiler_version, host_compiler
from export.c_host import CController
from export.c_library import c_library
from export.c_release import int8_library
from export.eager import EagerController
from export.onnx_graph import build_controller
from export.onnx_session import OnnxController
from export.parity import control_cases
from export.program import ControllerProgram
from export.random_program import random_program, random_window
from export.reference_model import encode
from export.reference_mpc import evaluate, optimise, shift
from export.weights import Array

# One eager step takes as long as some ten of the others.
_EAGER_EVERY = 5
_CALIBRATION = 20
# CasADi's solvers take as long as hundreds of our control steps.
_CASADI_EVERY = 50
# A solver that takes longer is timed once.
_CASADI_PATIENCE_MS = 2000.0
_WARM = 3


def main(
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures here.")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Control steps of each lowering.")] = 300,
    dynamics_width: int = 256,
    decoder_width: int = 128,
    horizon: int = 25,
    iterations: int = 5,
) -> None:
    """Time the control step and print a table."""
    torch.set_num_threads(1)
    model = ModelConfig(dynamics_width=dynamics_width, decoder_width=decoder_width)
    program = random_program(0, model=model, mpc=MpcConfig(horizon=horizon, iterations=iterations))
    (case,) = control_cases(program, count=1)
    graphs = {name: build_controller(program, name).SerializeToString() for name in ("float32", "int8")}
    load_ms = [_timed(lambda: OnnxController(graphs["float32"])) for _ in range(5)]
    eager = EagerController(program, torch.float32)
    whole, small = OnnxController(graphs["float32"]), OnnxController(graphs["int8"])
    compiler = host_compiler()
    c = CController(program, c_library(program), compiler=compiler)
    rng = np.random.default_rng(0)
    c_int8 = CController(
        program,
        int8_library(program, [random_window(program, rng) for _ in range(_CALIBRATION)]),
        compiler=compiler,
    )
    steps: dict[str, Callable[[], object]] = {
        "eager_ms": lambda: eager.control_step(case.window, case.plan, case.free),
        "onnx_ms": lambda: whole.control_step(case.window, case.plan, case.free),
        "onnx_int8_ms": lambda: small.control_step(case.window, case.plan, case.free),
        "c_ms": lambda: c.control_step(case.window, case.plan, case.free),
        "c_int8_ms": lambda: c_int8.control_step(case.window, case.plan, case.free),
    }
    problem = _Problem.warm(program, case.window)
    solvers = _casadi(problem)
    plans: dict[str, Array] = {}
    for step in steps.values():
        step()  # warm caches and allocators
    times: dict[str, list[float]] = {name: [] for name in (*steps, *solvers)}
    console = Console(stderr=True)
    for name, solve in track(list(solvers.items()), "CasADi", console=console):
        start = time.perf_counter()
        plans[name] = solve()
        times[name].append((time.perf_counter() - start) * 1e3)
    for i in track(range(repeats), "control steps", console=console):
        for name, step in steps.items():
            if name != "eager_ms" or i % _EAGER_EVERY == 0:
                times[name].append(_timed(step))
        if i % _CASADI_EVERY == 0:
            for name, solve in solvers.items():
                if times[name][0] <= _CASADI_PATIENCE_MS:
                    times[name].append(_timed(solve))

    casadi: list[dict[str, Any]] = [
        {"variant": name, "ms": float(np.median(times.pop(name))), "cost": problem.cost(plan)}
        for name, plan in plans.items()
    ]
    figures: dict[str, Any] = {name: float(np.median(values)) for name, values in times.items()}
    figures["onnx_load_ms"] = float(np.median(load_ms))
    figures["min"] = {name: min(values) for name, values in times.items()} | {"onnx_load_ms": min(load_ms)}
    figures["onnx_bytes"], figures["onnx_int8_bytes"] = len(graphs["float32"]), len(graphs["int8"])
    figures["c_workspace_bytes"], figures["c_int8_workspace_bytes"] = c.workspace_bytes, c_int8.workspace_bytes
    if casadi:
        figures["cost"] = {"start": problem.cost(problem.start), "adam": problem.cost(problem.adam())}
        figures["casadi"] = casadi
        enough = [row for row in casadi if row["cost"] <= figures["cost"]["adam"]]
        figures["casadi_ms"] = min(row["ms"] for row in enough or casadi)
    figures["settings"] = {
        "dynamics_width": dynamics_width,
        "decoder_width": decoder_width,
        "horizon": horizon,
        "iterations": iterations,
        "repeats": repeats,
        "threads": 1,
        "c_flags": " ".join(OPTIMISED),
    }
    names = ("torch", "onnxruntime", "numpy", *(("casadi",) if casadi else ()))
    figures["versions"] = {name: version(name) for name in names}
    figures["versions"]["c_compiler"] = compiler_version(compiler)
    figures["machine"] = platform.processor() or platform.machine()
    _print(figures)
    if json_file is not None:
        with replacing(json_file) as temporary:
            temporary.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Problem:
    """A control step for every solver: state, action in force, and the shifted last plan."""

    program: ControllerProgram
    z: Array
    previous: float
    start: Array

    @classmethod
    def warm(cls, program: ControllerProgram, window: Array) -> "_Problem":
        """After a few control steps from a zero plan at the same window."""
        z, horizon, previous = encode(program, window), program.mpc.horizon, float(window[-1, -1])
        problem = cls(program=program, z=z, previous=previous, start=np.zeros(horizon))
        for _ in range(_WARM):
            problem = replace(problem, start=shift(problem.adam()))
        return problem

    def adam(self) -> Array:
        """Our plan: the reference's, whatever the lowering."""
        weights = np.array(self.program.mpc.weights.as_tuple())
        return optimise(self.program, self.z, self.start, self.previous, np.ones_like(self.start), weights)

    def cost(self, plan: Array) -> float:
        weights = np.array(self.program.mpc.weights.as_tuple())
        return evaluate(self.program, self.z, plan, self.previous, weights).cost


def _casadi(problem: _Problem) -> dict[str, Callable[[], Array]]:
    """CasADi's solvers by name; none where it is not installed."""
    if importlib.util.find_spec("casadi") is None:
        return {}
    from benchmarks.casadi_mpc import variants

    return {
        variant.name: partial(variant.solve, problem.z, problem.start, problem.previous)
        for variant in variants(problem.program)
    }


def _timed(step: Callable[[], object]) -> float:
    """Wall time in ms."""
    start = time.perf_counter()
    step()
    return (time.perf_counter() - start) * 1e3


def _print(figures: dict[str, Any]) -> None:
    table = Table("one control step", "median ms", "min ms", "times faster", "KB")
    rows: tuple[tuple[str, str, str | None], ...] = (
        ("eager PyTorch", "eager_ms", None),
        ("ONNX float32", "onnx_ms", "onnx_bytes"),
    )
    rows += (("ONNX int8 weights", "onnx_int8_ms", "onnx_int8_bytes"), ("C float32", "c_ms", None))
    rows += (("C int8, integer products", "c_int8_ms", None),)
    for label, key, size in rows:
        table.add_row(
            label,
            f"{figures[key]:.2f}",
            f"{figures['min'][key]:.2f}",
            f"{figures['eager_ms'] / figures[key]:.1f}",
            "" if size is None else f"{figures[size] / 1024:.0f}",
        )
    table.add_row(
        "session load, ONNX float32", f"{figures['onnx_load_ms']:.1f}", f"{figures['min']['onnx_load_ms']:.1f}"
    )
    Console().print(table)
    if "casadi" in figures:
        costs = figures["cost"]
        table = Table("the same control step in CasADi", "median ms", "cost", "gain over ours")
        table.add_row(
            f"ours, {figures['settings']['iterations']} iterations of Adam", "", f"{costs['adam']:.5f}", "1.00"
        )
        for row in figures["casadi"]:
            share = (costs["start"] - row["cost"]) / (costs["start"] - costs["adam"])
            table.add_row(row["variant"], f"{row['ms']:.0f}", f"{row['cost']:.5f}", f"{share:.2f}")
        Console().print(table)


if __name__ == "__main__":
    typer.run(main)
