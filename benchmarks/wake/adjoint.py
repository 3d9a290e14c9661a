"""Gradients through the flow: how exact they are, what they cost, and what they keep in memory.

    python -m benchmarks adjoint [--json FILE] [--refinement 0.75 ...]

One core. Of the summed wall drag of a window under random actions, from the shipped wake. Forward and backward periods
are timed in turn; the figures are medians.
"""

from dataclasses import replace
from statistics import median
from time import process_time
from typing import Annotated, Any, Final

import numpy as np
import typer

from benchmarks.common.command_line import JsonFile, console, save, track
from contract.config.plant import FlowConfig
from contract.results import versions
from wake.truck.regrid import moved
from wake.truck.state import developed_state
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake

SUBSTEPS: Final = {1.0: 30}
"""Steps a period of the default mesh; coarser ones have the roads' 15."""
WINDOW, ROUNDS, STEP = 20, 5, 1e-5
"""Control periods, windows timed, and half the difference of an action that gradients are held against."""


def main(
    json_file: JsonFile = None,
    refinement: Annotated[list[float], typer.Option(help="Mesh: divides every spacing.")] = [0.75, 1.0],  # noqa: B006
) -> None:
    """Measure each mesh and print a line."""
    figures = [_measure(one) for one in track(refinement, "meshes", "meshes")]
    for row in figures:
        console.print(row)
    facts = {"window": WINDOW, "rounds": ROUNDS, "step": STEP, "versions": versions("stillwake", "numpy", "numba")}
    save(json_file, figures=figures, facts=facts)


def _measure(refinement: float) -> dict[str, Any]:
    plant = TruckWake(FlowConfig(refinement=refinement, substeps=SUBSTEPS.get(refinement, 15)))
    start = moved(developed_state(), TruckWake().grid, plant, duration=2.0)
    actions = np.random.default_rng(1).uniform(-0.05, 0.05, WINDOW)
    drag = replace(no_weights(len(plant.layout)), Cd=1.0)
    tape, times = Tape(plant), []
    for _ in range(1 + ROUNDS):
        began = process_time()
        _drag(plant, start, actions)
        plain = process_time()
        plant.reset(start)
        tape.restart()
        for action in actions:
            tape.advance(action)
        taped = process_time()
        gradient = np.array([tape.back(drag) for _ in actions])[::-1]
        times.append((plain - began, taped - plain, process_time() - taped))
    moves = STEP * np.eye(WINDOW)[:: WINDOW // 4]
    slopes = [
        (_drag(plant, start, actions + move) - _drag(plant, start, actions - move)) / (2 * STEP) for move in moves
    ]
    forward, recording, back = (median(column) / WINDOW for column in zip(*times[1:], strict=True))
    return {
        "cells": plant.grid.shape[0] * plant.grid.shape[1],
        "gradient_error": float(np.abs(gradient[:: WINDOW // 4] - slopes).max() / np.abs(slopes).max()),
        "periods_ratio": back / forward,
        "recording_ratio": recording / forward,
        "forward_ms": 1e3 * forward,
        "memory_mb": tape.memory_mb / WINDOW,
    }


def _drag(plant: TruckWake, start: Any, actions: Any) -> float:
    plant.reset(start)
    return sum(plant.advance(action).Cd for action in actions)
