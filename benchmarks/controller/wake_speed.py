"""The computing time of a time step of the plant, the shares of its parts, and its ratio to the machine's limits.

    python -m benchmarks wake-speed [--json FILE]

The measurement runs on one core. Every figure is the median over rounds that measure all cases in turn, because times
on a machine fluctuate. Memory bandwidth and arithmetic speed are measured in the same rounds, on arrays of the plant's
size.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from statistics import median
from time import process_time
from typing import Any, Final
from unittest.mock import patch

import numpy as np
from numba import njit
from threadpoolctl import threadpool_limits

from benchmarks.common.command_line import JsonFile, report, track
from benchmarks.controller import tables
from contract.arrays import Array
from contract.config.plant import FlowConfig
from contract.results import versions
from wake.solver import kernels, poisson
from wake.truck.develop import develop
from wake.truck.truck_wake import TruckWake

REFINEMENTS: Final = (0.7, 1.0, 1.4)
"""Divisors of every spacing of the mesh."""
ROUNDS: Final = 9
PRECISIONS: Final = {"double": np.float64, "single": np.float32}
_PARTS: Final = {
    "stages": "convection, diffusion, walls",
    "clear_walls": "walls",
    "divergence": "divergence",
    "solve_into": "Poisson",
    "correct": "correction",
    "fill_edges": "edges",
    "fill_walls": "walls",
}
# The numbers of values read and written per cell if every array is accessed once per pass. A stage reads u, v, p and
# both rates, and writes all of them except p. The correction reads u, v, p and phi, and writes u, v and p.
_STAGE_NUMBERS, _CORRECTION_NUMBERS = 9, 7


def main(json_file: JsonFile = None) -> None:
    """Measure the cases and print a table."""
    cases = [(value, name) for value in REFINEMENTS for name in PRECISIONS]
    plants = [_plant(*case) for case in cases]
    spent: list[defaultdict[str, list[float]]] = [defaultdict(list) for _ in plants]
    with threadpool_limits(1):
        for _ in track(range(ROUNDS), "rounds", "rounds"):
            for wake, times in zip(plants, spent, strict=True):
                _visit(wake, times)
    timed = zip(cases, plants, spent, strict=True)
    rows = [{"precision": precision, **_row(wake, times)} for (_, precision), wake, times in timed]
    report(json_file, rows, {"rounds": ROUNDS, "versions": versions("stillwake", "numpy", "numba")}, tables.steps)


def _plant(refinement: float, precision: str) -> TruckWake:
    substeps = round(FlowConfig().substeps * max(1.0, refinement))
    wake = TruckWake(FlowConfig(substeps=substeps, refinement=refinement), precision=PRECISIONS[precision])
    develop(wake, 3.0)
    return wake


def _visit(wake: TruckWake, times: defaultdict[str, list[float]]) -> None:
    """Time three control periods (no jets, full amplitude, each part separately), and the machine's two limits."""
    limit = wake.config.action_limit
    times["free"].append(_clock(lambda: wake.advance(0.0)))
    wake.advance(limit)
    times["forced"].append(_clock(lambda: wake.advance(-limit)))
    wake.advance(0.0)
    with _clocked_parts() as parts:
        wake.advance(0.0)
    for name, seconds in parts.items():
        times[name].append(seconds)
    precision = wake.solver.precision
    a, b, c = (np.ones(wake.grid.shape, precision) for _ in range(3))
    times["triad"].append(min(_clock(lambda: _triad(a, b, c)) for _ in range(20)))
    h = wake.grid.shape[1] // 2
    rows, square = np.ones((wake.grid.shape[0], h), precision), np.ones((h, h), precision)
    times["product"].append(min(_clock(lambda: rows @ square) for _ in range(20)))


def _row(wake: TruckWake, times: dict[str, list[float]]) -> dict[str, Any]:
    (nx, ny), steps = wake.grid.shape, wake.config.substeps
    cells, h = nx * ny, ny // 2
    period = {name: median(values) for name, values in times.items()}
    parts = {label: sum(period[key] for key, other in _PARTS.items() if other == label) for label in _PARTS.values()}
    # The triad reads or writes three numbers for each element.
    size = wake.flow.flat.itemsize
    bandwidth = 3 * size * cells / period["triad"]
    arithmetic = 2 * nx * h * h / period["product"]
    sweeps = size * cells * (3 * _STAGE_NUMBERS + _CORRECTION_NUMBERS)
    # There are two forward and two inverse transforms, each of which has an even and an odd half.
    transforms = 4 * 2 * nx * h * h
    return {
        "cells": cells,
        "cpu_s_per_t_c": period["free"] / wake.config.control_period,
        "forced_cpu_s_per_t_c": period["forced"] / wake.config.control_period,
        "ns_per_cell_and_step": 1e9 * period["free"] / steps / cells,
        "floor_sweeps_ns": 1e9 * sweeps / bandwidth / cells,
        "floor_transforms_ns": 1e9 * transforms / arithmetic / cells,
        "shares": {label: seconds / sum(parts.values()) for label, seconds in parts.items()},
    }


@contextmanager
def _clocked_parts() -> Iterator[dict[str, float]]:
    spent: dict[str, float] = dict.fromkeys(_PARTS, 0.0)

    def clocked(name: str, original: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object) -> object:
            began = process_time()
            result = original(*arguments)
            spent[name] += process_time() - began
            return result

        return call

    with ExitStack() as stack:
        for name in _PARTS:
            owner: Any = poisson.PoissonSolver if name == "solve_into" else kernels
            stack.enter_context(patch.object(owner, name, clocked(name, getattr(owner, name))))
        yield spent


def _clock(work: Callable[[], object]) -> float:
    began = process_time()
    work()
    return process_time() - began


@njit(cache=True, fastmath={"contract"})
def _triad(a: Array, b: Array, c: Array) -> None:
    half = a.dtype.type(0.5)
    for i in range(a.shape[0]):
        ai, bi, ci = a[i], b[i], c[i]
        for j in range(ai.shape[0]):
            ai[j] = bi[j] + half * ci[j]
