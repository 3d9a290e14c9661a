"""The length of a window up to which a gradient through the flow simulation predicts the effect of a finite step of the
jets.

    python -m benchmarks horizon [--json FILE]

The differentiated scalar is the mean wall drag over a window that starts in the shipped wake, on the mesh of the
trainings. The tape gives its gradient with respect to the action of the first period. For comparison, slopes are
central differences of whole runs, in which this action is changed by steps that are shares of its bound.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.common.command_line import JsonFile, report, track
from benchmarks.wake import tables
from contract.arrays import Array
from contract.config.plant import FlowConfig
from contract.results import versions
from wake.truck.develop import moved
from wake.truck.state import State, developed_state
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake

WINDOWS: Final = (5.0, 10.0, 20.0, 40.0, 60.0)
"""Lengths of the windows in t_c; a shedding cycle takes 5 t_c."""
STEPS: Final = (1e-5, 0.01, 0.1)
"""Steps of the action, as shares of its bound. The first step gives nearly the derivative; a controller would take
steps like the other two."""


def main(json_file: JsonFile = None) -> None:
    """Compute gradients and slopes, and print a table."""
    flow = FlowConfig(refinement=0.75, substeps=15)
    plant = TruckWake(flow)
    start = moved(developed_state(), TruckWake().grid, plant, duration=2.0)
    counts = [round(window / flow.control_period) for window in WINDOWS]
    slopes = []
    for share in track(STEPS, "steps", "steps"):
        step = share * flow.action_limit
        runs = [_means(plant, start, sign * step, max(counts)) for sign in (1.0, -1.0)]
        slopes.append((runs[0] - runs[1]) / (2.0 * step))
    figures = []
    for window, count in track(list(zip(WINDOWS, counts, strict=True)), "windows", "windows"):
        gradient = _gradient(plant, start, count)
        errors = [abs(float(slope[count - 1]) / gradient - 1.0) for slope in slopes]
        figures.append({"window": window, "gradient": gradient, "errors": errors})
    facts = {"refinement": flow.refinement, "steps": STEPS, "versions": versions("stillwake", "numpy", "numba")}
    report(json_file, figures, facts, tables.horizon)


def _means(plant: TruckWake, start: State, action: float, count: int) -> Array:
    """Return the mean drag over windows of 1 to `count` periods, shape (count,), if the first period has this
    action."""
    plant.reset(start)
    drags = [plant.advance(action if period == 0 else 0.0).Cd for period in range(count)]
    return np.cumsum(drags) / np.arange(1, count + 1)


def _gradient(plant: TruckWake, start: State, count: int) -> float:
    plant.reset(start)
    tape = Tape(plant)
    for _ in range(count):
        tape.advance(0.0)
    drag = replace(no_weights(len(plant.layout)), Cd=1.0 / count)
    return [tape.back(drag) for _ in range(count)][-1]
