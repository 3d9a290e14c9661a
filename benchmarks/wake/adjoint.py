"""Gradients through the flow simulation: their error, computing time and memory.

    python -m benchmarks adjoint [--json FILE] [--refinement 0.75 ...]

The measurement runs on one core. The wall drag is summed over a window that starts in the shipped wake and has random
actions; its gradient with respect to the actions is computed in double and in single precision. Both precisions, and
forward and backward periods, are timed in turn; the figures are medians. The gradient in double precision is compared
with finite differences of whole runs, and the gradient in single precision with that in double precision.
"""

from dataclasses import replace
from statistics import median
from time import process_time
from typing import Annotated, Any, Final

import numpy as np
import typer

from benchmarks.common.command_line import JsonFile, console, save, track
from contract.arrays import Array
from contract.config.plant import FlowConfig
from contract.results import versions
from train.fitting.threads import without_denormals
from wake.truck.averages import over_cycles
from wake.truck.develop import moved
from wake.truck.state import State, developed_state
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake

SUBSTEPS: Final = {1.0: 30}
"""Number of time steps per control period on the default mesh. Coarser meshes have 15, as in the table of ways to
reduce drag."""
WINDOW, ROUNDS, STEP = 20, 5, 1e-5
"""Number of control periods of a window, number of timed windows, and the amount by which an action is raised and
lowered for finite differences."""
LONG: Final = 500
"""Number of control periods of the run without jets in each precision; the drag is averaged over their last half."""
PRECISIONS: Final = {"double": np.float64, "single": np.float32}


def main(
    json_file: JsonFile = None,
    refinement: Annotated[list[float], typer.Option(help="Mesh: divides every spacing.")] = [0.75, 1.0],  # noqa: B006
) -> None:
    """Measure on each mesh, and print a line for each."""
    figures = [row for one in track(refinement, "meshes", "meshes") for row in _measure(one)]
    for row in figures:
        console.print(row)
    facts = {"window": WINDOW, "rounds": ROUNDS, "step": STEP, "versions": versions("stillwake", "numpy", "numba")}
    save(json_file, figures=figures, facts=facts)


def _measure(refinement: float) -> list[dict[str, Any]]:
    flow = FlowConfig(refinement=refinement, substeps=SUBSTEPS.get(refinement, 15))
    plants = {name: TruckWake(flow, precision=precision) for name, precision in PRECISIONS.items()}
    start = moved(developed_state(), TruckWake().grid, plants["double"], duration=2.0)
    actions = np.random.default_rng(1).uniform(-0.05, 0.05, WINDOW)
    tapes = {name: Tape(plant) for name, plant in plants.items()}
    times: dict[str, list[tuple[float, float, float]]] = {name: [] for name in plants}
    gradients = dict[str, Any]()
    # The training runs without denormal numbers, so the measurement does so too.
    with without_denormals():
        for _ in range(1 + ROUNDS):
            for name, plant in plants.items():
                gradients[name], spent = _visit(plant, tapes[name], start, actions)
                times[name].append(spent)
    moves = STEP * np.eye(WINDOW)[:: WINDOW // 4]
    double = plants["double"]
    slopes = np.array(
        [(_drag(double, start, actions + move) - _drag(double, start, actions - move)) / (2 * STEP) for move in moves]
    )
    errors = {
        "double": np.abs(gradients["double"][:: WINDOW // 4] - slopes).max() / np.abs(slopes).max(),
        "single": np.abs(gradients["single"] - gradients["double"]).max() / np.abs(gradients["double"]).max(),
    }
    return [
        {
            "precision": name,
            "cells": plant.grid.shape[0] * plant.grid.shape[1],
            "gradient_error": float(errors[name]),
            "drag": _mean_drag(plant, start),
            **_costs(times[name][1:]),
            "memory_mb": tapes[name].memory_mb / WINDOW,
        }
        for name, plant in plants.items()
    ]


def _visit(plant: TruckWake, tape: Tape, start: State, actions: Array) -> tuple[Array, tuple[float, float, float]]:
    """Return the gradient, and the times in s of a run without tape, of a run with tape, and of the backward pass."""
    drag = replace(no_weights(len(plant.layout)), Cd=1.0)
    began = process_time()
    _drag(plant, start, actions)
    plain = process_time()
    plant.reset(start)
    tape.restart()
    for action in actions:
        tape.advance(action)
    taped = process_time()
    gradient = np.array([tape.back(drag) for _ in actions])[::-1]
    return gradient, (plain - began, taped - plain, process_time() - taped)


def _costs(times: list[tuple[float, float, float]]) -> dict[str, float]:
    forward, recording, back = (median(column) / WINDOW for column in zip(*times, strict=True))
    return {
        "periods_ratio": back / forward,
        "recording_ratio": recording / forward,
        "forward_ms": 1e3 * forward,
        "gradient_periods_per_s": 1.0 / (recording + back),
    }


def _drag(plant: TruckWake, start: State, actions: Array) -> float:
    plant.reset(start)
    return sum(plant.advance(action).Cd for action in actions)


def _mean_drag(plant: TruckWake, start: State) -> float:
    """Return the mean drag of the wake without jets, over the whole cycles in the last half of the periods."""
    plant.reset(start)
    samples = [plant.advance(0.0) for _ in range(LONG)][LONG // 2 :]
    t, Cl, Cd = (np.array([getattr(sample, name) for sample in samples]) for name in ("t", "Cl", "Cd"))
    return float(over_cycles(t, Cl).mean(Cd))
