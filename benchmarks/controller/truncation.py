"""What stopping the optimiser after a few iterations costs (paper, section 2.4.2).

    python -m benchmarks truncation [--model DIR] [--bundle B] [--dataset H5] [--json FILE]

The NumPy reference plans at snapshots of a recording: an episode recorded under a controller where the data set has
one for training, else the chirp. The jets are the recording's, not the plan's, so that every setting meets the same
windows. Three questions: how far a plan is from the converged optimum after so many iterations, cold (from a zero plan)
and warm (from the last plan, shifted, as in the loop); whether random starts end at the same cost; and what the
learning rate changes, with and without noise on the pressures.

A gap is J - J* as a share of the gain J(zero plan) - J*, where J* is the lowest cost found. An action error is
|a_0 - a_0*| as a share of the action limit: a_0 is what is applied.
"""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
from rich.table import Table

from benchmarks.common.command_line import MODEL, Dataset, JsonFile, Model, console, save, track
from benchmarks.controller.converged import EVALUATIONS, FALLING, Optimum, converged, valleys
from benchmarks.controller.situations import LEAD, choose_episode, encode_windows, receding, snapshot_steps
from contract.arrays import Array
from contract.config.controller import MpcConfig
from contract.config.loading import load_config
from contract.errors import ExportError
from contract.model import model_folder
from contract.recording import dataset
from contract.recording.dataset import Episode
from contract.release import bundle as bundles
from contract.results import versions
from contract.shipped import RECORDING
from export.program.controller_program import ControllerProgram
from export.program.from_training import program_of
from export.reference.mpc import adam, plan_cost, shift

ITERATIONS: Final = (1, 2, 3, 5, 10, 20, 50)
LEARNING_RATES: Final = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
NOISE: Final = 0.1
"""Deviation of the noise on a sensor, as a share of the sensor's own."""
NEAR: Final = 0.01
"""A converged plan counts as good as the best if it misses no more than this share of the gain."""


def main(
    json_file: JsonFile = None,
    bundle: Annotated[Path | None, typer.Option(help="Settings of this bundle, which must be of the model.")] = None,
    model: Model = MODEL,
    data: Dataset = RECORDING,
    snapshots: Annotated[int, typer.Option(help="Over the episode.", min=2)] = 20,
    starts: Annotated[int, typer.Option(help="Random starts a snapshot.", min=2)] = 20,
    steps: Annotated[int, typer.Option(help="Consecutive steps for each learning rate.", min=10)] = 50,
    seed: Annotated[int, typer.Option(help="Of random starts and noise.")] = 0,
) -> None:
    """Measure, print tables."""
    trained = model_folder.read(model)
    program = program_of(trained, _settings(bundle, trained.weights_sha256))
    episode = choose_episode(dataset.read(data))
    rng = np.random.default_rng(seed)
    figures = at_snapshots(program, episode, snapshots, starts, rng)
    figures["learning_rates"] = by_learning_rate(program, episode, steps, rng)
    _print(figures)
    facts = {
        "episode": episode.name,
        "role": episode.role,
        "snapshots": snapshots,
        "random_starts": starts,
        "steps": steps,
        "lead": LEAD,
        "noise": NOISE,
        "optimum": {"adam_iterations": len(FALLING), "quasi_newton_evaluations": EVALUATIONS},
        "seed": seed,
        "horizon": program.mpc.horizon,
        "learning_rate": program.mpc.learning_rate,
        "weights": asdict(program.mpc.weights),
        "weights_sha256": trained.weights_sha256,
        "versions": versions("numpy", "scipy"),
    }
    save(json_file, figures=figures, facts=facts)


def at_snapshots(
    program: ControllerProgram, episode: Episode, snapshots: int, starts: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Gaps and action errors by number of iterations, and where random starts end."""
    horizon, limit = program.mpc.horizon, program.action_limit
    z, previous_action = encode_windows(program, episode, snapshot_steps(program, episode, snapshots))
    warm = receding(program, z[:-1], previous_action[:-1], np.full(snapshots, program.mpc.learning_rate))[-1]

    learning_rates = np.full(max(ITERATIONS), program.mpc.learning_rate)
    ladder: dict[tuple[str, int], list[tuple[float, float]]] = {}
    spreads, optimisers = [], []
    for i in track(range(snapshots), "snapshots", "snapshots"):
        now, before = z[-1, i], float(previous_action[-1, i])
        begin = {"cold": np.zeros(horizon), "warm": shift(warm[i])}
        plans, scattered = np.array(list(begin.values())), rng.uniform(-limit, limit, (starts, horizon))
        best = converged(program, now, before, plans, scattered)
        gain = float(plan_cost(program, now, np.zeros(horizon), before)) - best.cost
        for number, found in enumerate([plans, *adam(program, now, plans, before, learning_rates)]):
            if number not in (0, *ITERATIONS):
                continue
            gaps = (plan_cost(program, now, found, before) - best.cost) / gain
            errors = np.abs(found[:, 0] - best.plan[0]) / limit
            for name, gap, error in zip(begin, gaps, errors, strict=True):
                ladder.setdefault((name, number), []).append((gap, error))
        spreads.append(_spread(program, now, before, best, gain))
        optimisers.append(np.array([best.quasi_newton, best.scattered_costs.min()]) - best.cost)
        optimisers[-1] /= gain
    return {
        "iterations": [
            {"start": name, "iterations": number, **_percent(np.array(values))}
            for (name, number), values in ladder.items()
        ],
        "starts": {name: float(np.mean([item[name] for item in spreads])) for name in spreads[0]}
        | {"valleys_most": max(item["valleys"] for item in spreads)},
        "optimisers": dict(
            zip(("quasi_newton_gap", "scattered_adam_gap"), 100.0 * np.mean(optimisers, axis=0), strict=True)
        ),
    }


def by_learning_rate(
    program: ControllerProgram, episode: Episode, steps: int, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Receding plans over consecutive steps at the end of the episode, each rate with and without noise."""
    count, limit = len(episode) - program.window + 1, program.action_limit
    last = range(count - LEAD - steps, count)
    z, previous_action = encode_windows(program, episode, last)
    noisy_z, _ = encode_windows(program, _with_noise(episode, rng), last)
    n = len(LEARNING_RATES)
    both = np.concatenate([np.repeat(z[:, None], n, axis=1), np.repeat(noisy_z[:, None], n, axis=1)], axis=1)
    plans = receding(program, both, np.repeat(previous_action[:, None], 2 * n, axis=1), np.tile(LEARNING_RATES, 2))
    z, previous_action, plans = z[LEAD:], previous_action[LEAD:], plans[LEAD:]

    # The optimum of every step by Adam alone, from a zero plan, the plans of two rates, and a random one.
    starts = (np.zeros_like(plans[:, 0]), plans[:, 2], plans[:, n - 1], rng.uniform(-limit, limit, plans[:, 0].shape))
    ended = []
    for start in track(starts, "optimum of every step", "steps"):
        *_, plan = adam(program, z, start, previous_action, FALLING)
        ended.append(plan)
    candidates = np.stack([*ended, *(plans[:, j] for j in range(n))], axis=1)
    found = plan_cost(program, z[:, None], candidates, previous_action[:, None])
    best = candidates[np.arange(steps), found.argmin(axis=1)]
    gain = plan_cost(program, z, np.zeros_like(best), previous_action) - found.min(axis=1)
    applied = plans[:, :, 0] / limit
    rows: list[dict[str, Any]] = []
    for j, rate in enumerate(LEARNING_RATES):
        gaps = (found[:, len(starts) + j] - found.min(axis=1)) / gain
        errors = np.abs(applied[:, j] - best[:, 0] / limit)
        rows.append(
            {
                "learning_rate": rate,
                **_percent(np.column_stack([gaps, errors])),
                "roughness": 100.0 * float(np.abs(np.diff(applied[:, j])).mean()),
                "roughness_noisy": 100.0 * float(np.abs(np.diff(applied[:, n + j])).mean()),
                "noise_in_action": 100.0 * float(np.sqrt(((applied[:, n + j] - applied[:, j]) ** 2).mean())),
            }
        )
    optimum = best[:, 0] / limit
    rows.append(
        {
            "learning_rate": None,
            **_percent(np.zeros((1, 2))),
            "roughness": 100.0 * float(np.abs(np.diff(optimum)).mean()),
            "roughness_noisy": None,
            "noise_in_action": None,
        }
    )
    return rows


def _settings(path: Path | None, weights_sha256: str) -> MpcConfig:
    if path is None:
        return load_config().mpc
    manifest = bundles.load(path).manifest
    if manifest.weights_sha256 != weights_sha256:
        raise ExportError(f"bundle {path}: made of weights {manifest.weights_sha256[:12]}, not {weights_sha256[:12]}")
    return manifest.mpc


def _with_noise(episode: Episode, rng: np.random.Generator) -> Episode:
    pressure = episode.series["Cp"]
    noise = NOISE * pressure.std(axis=0) * rng.standard_normal(pressure.shape)
    return replace(episode, series={**episode.series, "Cp": pressure + noise})


def _spread(
    program: ControllerProgram, z: Array, previous_action: float, best: Optimum, gain: float
) -> dict[str, float]:
    """Of the random starts: costs in per cent of the optimum's and of the gain, first actions in per cent of limit."""
    ended = best.scattered_costs
    near = best.scattered[ended <= ended.min() + NEAR * gain]
    return {
        "deviation_of_cost": 100.0 * float(ended.std() / abs(best.cost)),
        "deviation_of_gain": 100.0 * float(ended.std() / gain),
        "range_of_gain": 100.0 * float(np.ptp(ended) / gain),
        "worst_gap": 100.0 * float((ended.max() - best.cost) / gain),
        "near_share": 100.0 * len(near) / len(ended),
        "first_action_range_near": 100.0 * float(np.ptp(near[:, 0]) / program.action_limit),
        "valleys": valleys(program, z, previous_action, best.scattered, gain),
    }


def _percent(values: Array) -> dict[str, float]:
    """Mean and largest gap and action error, (n, 2), in per cent."""
    gap, error = 100.0 * values.T
    return {
        "gap": float(gap.mean()),
        "gap_worst": float(gap.max()),
        "action_error": float(error.mean()),
        "action_error_worst": float(error.max()),
    }


def _print(figures: dict[str, Any]) -> None:
    for title, names, rows in (
        ("iterations", ("start", "iterations"), figures["iterations"]),
        ("learning rate", ("learning_rate",), figures["learning_rates"]),
        ("random starts", (), [figures["starts"]]),
        ("optimisers", (), [figures["optimisers"]]),
    ):
        columns = [*names, *(name for name in rows[0] if name not in names)]
        table = Table(*columns, title=f"{title} (per cent)")
        for row in rows:
            table.add_row(*(f"{row[c]:.3g}" if isinstance(row[c], float) else str(row[c]) for c in columns))
        console.print(table)
