"""The improvement of the prior's plan by the controller's iterations, measured in pairs of runs with and without
iterations.

    python -m benchmarks iterations [--workers 2] [--json FILE]

A release's iterations act on the cost terms for which its prior was not trained (`unknown_to_prior` in
`contract.controller.goal`). So the run without iterations uses the same release, with the weights of these terms set to
0. A case that itself sets these weights to 0 is not run. Both runs of a pair start in the same wake. The table shows
the change, in per cent, of the cost with the case's weights, and the 95 % interval of the mean change by Student's t.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from benchmarks.common.command_line import JsonFile, Parts, Workers, kept_runs, report
from benchmarks.release import tables
from benchmarks.release.release_loop import SPANS, facts_of, half_width_95, kept_starts, run_from
from contract.config.loading import load_config
from contract.controller.calibration import Calibration
from contract.controller.goal import DEAREST_EFFORT, DEAREST_LIFT
from contract.release import bundle as bundles
from contract.shipped import BUNDLE
from ecu.calibrating import release_calibration
from firmware_sim.runs.statistics import NoAverages, averages


class Case(NamedTuple):
    """The differences between a case and the goal with which the prior was trained. `limit` is the action limit as a
    share of the release's limit. `delay` is the actuator's delay in control periods; the ECU knows this delay."""

    name: str
    weights: Mapping[str, float] = {}
    limit: float = 1.0
    delay: int = 0


CASES: Final = (
    Case("trained goal"),
    Case("jets limited to 60 %", limit=0.6),
    Case("known delay of 12 periods", delay=12),
    Case("effort four times the dearest", {"effort": 4.0 * DEAREST_EFFORT}),
    Case("lift four times the dearest", {"lift": 4.0 * DEAREST_LIFT}),
    Case("smoothness of 300", {"smoothness": 300.0}),
)
NONE: Final = {"drag_fluctuation": 0.0, "lift_mean": 0.0, "smoothness": 0.0, "rate": 0.0, "prior": 0.0}
"""Weights of the cost terms for which the prior was not trained, in the runs without iterations."""
PHASES: Final = 3


def main(json_file: JsonFile = None, parts: Parts = Path("runs/iterations"), workers: Workers = 1) -> None:
    """Run all pairs of runs and print a table."""
    release = bundles.load(BUNDLE)
    config = load_config()
    kept = kept_starts(parts, release, PHASES, config)
    own = release_calibration(release, replace(config, mpc=release.manifest.mpc))
    acting = [case for case in CASES if calibrated(own, case, iterated=True) != calibrated(own, case, iterated=False)]
    runs = {
        kept.path / f"{case.name}_{phase}_{'with' if iterated else 'without'}.json": (kept.start(phase), case, iterated)
        for case in acting
        for phase in range(PHASES)
        for iterated in (True, False)
    }
    costs = kept_runs(outcome, runs, workers=workers, label="iterations")
    changes: dict[str, list[float]] = {case.name: [] for case in acting}
    for (_, case, _), with_them, without in zip(list(runs.values())[::2], costs[::2], costs[1::2], strict=True):
        changes[case.name].append(100.0 * (with_them / without - 1.0))
    figures, pairs = {}, {case.name: len(changes.get(case.name, ())) for case in CASES}
    for case in CASES:
        values = changes.get(case.name, [0.0, 0.0])
        mean, half = float(np.mean(values)), half_width_95(values)
        figures[case.name] = {"mean": mean, "lower": mean - half, "upper": mean + half}
    facts = facts_of(release, iterations=release.manifest.mpc.iterations, pairs=pairs)
    upper = figures[CASES[0].name]["upper"]
    report(json_file, {"change_percent": figures, "change_percent_upper": upper}, facts, tables.iterations)


def calibrated(own: Calibration, case: Case, *, iterated: bool) -> Calibration:
    """Return the calibration of a run, with the weights of the case; the weights in `NONE` unless `iterated`."""
    weights = replace(own.weights, **{**case.weights, **({} if iterated else NONE)})
    return replace(own, weights=weights, action_limit=case.limit * own.action_limit, delay_steps=case.delay)


def outcome(start: Path, case: Case, iterated: bool) -> float:
    """Return the cost of the averaged part of a run, with the case's weights."""
    release = bundles.load(BUNDLE)
    config = replace(load_config(), mpc=release.manifest.mpc)
    ecu, vehicle = replace(config.ecu, delay_steps=case.delay), replace(config.vehicle, actuator_delay=case.delay)
    config = replace(config, ecu=ecu, vehicle=vehicle)
    own = release_calibration(release, config)
    log = run_from(start, release, config, calibration=calibrated(own, case, iterated=iterated))
    found = averages(log)
    if isinstance(found, NoAverages):
        raise RuntimeError(f"{case.name}: {found}")
    under, weights = found.under, calibrated(own, case, iterated=True).weights
    action = log.series["action"][-round((SPANS.controlled - SPANS.settle) / config.flow.control_period) :]
    steps = float(np.mean(np.diff(action) ** 2))
    cost = weights.drag_mean * under.Cd + weights.lift * under.abs_Cl + weights.effort * under.rms_action**2
    return cost + weights.smoothness * steps
