"""Environments in a batch: Gymnasium's vector environments and this project's own vector environment, in one run.

    python -m benchmarks vector-env [--json FILE] [--envs N]

Each environment takes the same random actions on the mesh of the trainings. The environments run in turn, so that a
disturbance of the machine affects all of them. The figures are medians of the wall time of a step, and of the time of a
window's gradient, for the whole batch.
"""

import time
from dataclasses import replace
from statistics import median
from typing import Annotated, Any, Final

import gymnasium
import numpy as np
import typer

from benchmarks.common.command_line import JsonFile, report, track
from benchmarks.wake import tables
from contract.config.plant import FlowConfig
from contract.results import versions
from wake.truck.develop import moved
from wake.truck.state import developed_state
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake
from wake.vector_env import BatchTape, TruckWakeVectorEnv

MODES: Final = ("sync", "async", "vector_entry_point")
ROUNDS: Final = 3
STEPS: Final = 10
"""Number of steps of a batch in a round, and number of control periods of a gradient's window."""


def main(
    json_file: JsonFile = None,
    envs: Annotated[int, typer.Option(min=1, help="Number of wakes.")] = 4,
) -> None:
    """Time the batches and print a table."""
    flow = FlowConfig(refinement=0.75, substeps=15)
    start = moved(developed_state(), TruckWake().grid, TruckWake(flow), duration=2.0)
    settings: dict[str, Any] = dict(config=flow, start=start, max_phase_steps=5)
    made = {mode: gymnasium.make_vec("wake.env:stillwake/TruckWake-v0", envs, mode, **settings) for mode in MODES}
    actions = np.random.default_rng(1).uniform(-0.07, 0.07, (STEPS, envs, 1)).astype(np.float32)
    batch = made["vector_entry_point"].unwrapped
    assert isinstance(batch, TruckWakeVectorEnv)
    steps: dict[str, list[float]] = {mode: [] for mode in MODES}
    gradients: dict[str, list[float]] = {"one after another": [], "batch": []}
    rewards = dict[str, Any]()
    for each in made.values():
        each.reset(seed=0)
        each.step(actions[0])
    for _ in track(range(ROUNDS), "rounds", "rounds"):
        for mode, each in made.items():
            each.reset(seed=0)
            began = time.perf_counter()
            rewards[mode] = [each.step(taken)[1] for taken in actions]
            steps[mode].append(time.perf_counter() - began)
        gradients["batch"].append(_batch(batch, actions[:, :, 0]))
        gradients["one after another"].append(_single(batch, actions[:, :, 0]))
    assert all(np.array_equal(one, rewards["sync"]) for one in rewards.values())
    for each in made.values():
        each.close()
    count = STEPS * envs
    figures = {
        "steps_per_s": {mode: count / median(times) for mode, times in steps.items()},
        "gradient_periods_per_s": {name: count / median(times) for name, times in gradients.items()},
    }
    facts = {
        "envs": envs,
        "steps": STEPS,
        "rounds": ROUNDS,
        "refinement": flow.refinement,
        "versions": versions("stillwake", "gymnasium", "numba"),
    }
    report(json_file, figures, facts, tables.vector)


def _batch(env: TruckWakeVectorEnv, actions: Any) -> float:
    env.reset(seed=0)
    tape = BatchTape(env)
    drag = [replace(no_weights(len(env.wakes[0].plant.layout)), Cd=1.0)] * env.num_envs
    began = time.perf_counter()
    for taken in actions:
        tape.advance(taken)
    for _ in actions:
        tape.back(drag)
    return time.perf_counter() - began


def _single(env: TruckWakeVectorEnv, actions: Any) -> float:
    env.reset(seed=0)
    tapes = [Tape(wake.plant) for wake in env.wakes]
    drag = replace(no_weights(len(env.wakes[0].plant.layout)), Cd=1.0)
    began = time.perf_counter()
    for tape, column in zip(tapes, actions.T, strict=True):
        for taken in column:
            tape.advance(float(taken))
        for _ in column:
            tape.back(drag)
    return time.perf_counter() - began
