"""The effect of a cost weight on side force, jets and drag, with a release in the closed loop.

    python -m benchmarks weights [--workers 2] [--json FILE]

The runs use the mesh on which the prior was trained, CAN, and the controller in int8. Each run has 15 t_c without
control and 85 t_c with control; the last 50 t_c are averaged. One weight at a time gets seven values over the range of
the prior's training, from three starts each. Spearman's rank correlation states how consistently a larger weight has a
larger effect.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.stats import spearmanr

from benchmarks.common.command_line import LOOP, JsonFile, Parts, Workers, console, kept_runs, made_from
from benchmarks.release.release_drawings import means
from benchmarks.release.release_loop import facts_of, run_from
from contract.config.loading import load_config
from contract.controller.goal import DEAREST_EFFORT, DEAREST_LIFT
from contract.release import bundle as bundles
from contract.shipped import BUNDLE
from ecu.calibrating import release_calibration
from firmware_sim.bench.simulation import Spans
from firmware_sim.campaign.folder import phases_apart
from firmware_sim.runs.summary import summary
from stillwake.console.outputs import save_json
from stillwake.parts.differentiable_wake import mesh_of
from wake.plants import own_wake
from wake.truck.state import save_state

SPANS: Final = Spans(lead_in=15.0, controlled=85.0, settle=35.0)
PHASES: Final = 3
SHARES: Final = (np.arange(7) / 6) ** 2
"""Values of a weight as shares of its largest value. They are equally spaced in the prior's input, which is the square
root of the weight."""
DEAREST: Final = {"lift": DEAREST_LIFT, "effort": DEAREST_EFFORT}
EFFECTS: Final = {"lift": ("abs_Cl_controlled",), "effort": ("rms_action", "jet_power_controlled")}
"""Figures of a run that a larger weight is meant to reduce, by the weight's name."""


class Case(NamedTuple):
    """The data of one run."""

    weight: str
    value: float
    phase: int


def main(json_file: JsonFile = None, parts: Parts = Path("runs/weights"), workers: Workers = 1) -> None:
    """Run the loop with every value of each weight from every start, and print the correlations."""
    release = bundles.load(BUNDLE)
    folder = started(parts / made_from(release.digest))
    values = ((name, float(round(share * dearest, 6))) for name, dearest in DEAREST.items() for share in SHARES)
    cases = [Case(*value, phase) for value in values for phase in range(PHASES)]
    runs = {
        folder / f"{case.weight}_{case.value:g}_{case.phase}.json": (folder / f"start_{case.phase}.npz", case)
        for case in cases
    }
    outcomes = kept_runs(outcome, runs, workers=workers, label="weights")
    rows = [{**case._asdict(), **outcome} for case, outcome in zip(cases, outcomes, strict=True)]
    figures = {"runs": rows, "spearman": _correlations(rows), "end_to_end": _end_to_end(rows)}
    console.print(figures["spearman"], figures["end_to_end"])
    mesh = mesh_of(load_config()).flow.refinement
    save_json(json_file, figures=figures, facts=facts_of(release, SPANS, mesh=mesh))


def started(folder: Path) -> Path:
    """Return a folder with the developed wake on the training's mesh at each starting phase of the shedding cycle."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / f"start_{PHASES - 1}.npz").is_file():
        config = mesh_of(load_config())
        wake, reached = own_wake(config), 0
        for phase, apart in enumerate(phases_apart(PHASES, config)):
            for _ in range(apart - reached):
                wake.advance(0.0)
            reached = apart
            save_state(folder / f"start_{phase}.npz", wake.state())
    return folder


def outcome(start: Path, case: Case) -> dict[str, Any]:
    """Return the figures of a run in which the ECU has the case's weight."""
    release, config = bundles.load(BUNDLE), mesh_of(load_config())
    own = release_calibration(release, config)
    calibration = replace(own, weights=replace(own.weights, **{case.weight: case.value}))
    found = summary(run_from(start, release, config, SPANS, calibration=calibration))
    return {key: found[key] for key in (*LOOP, "Cd_uncontrolled", "jet_power_controlled")}


def _correlations(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return Spearman's rank correlation between each weight and its effect over all runs, for several effects the
    smallest one. It is 1 if the figure always falls when the weight rises."""
    found = {}
    for weight, effects in EFFECTS.items():
        runs = [row for row in rows if row["weight"] == weight]
        values = [run["value"] for run in runs]
        found[weight] = min(-float(spearmanr(values, [run[name] for run in runs]).statistic) for name in effects)
    return found


def _end_to_end(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Return the reduction in per cent of each figure, from the weight 0 to the largest weight."""
    found = {}
    for weight, effects in EFFECTS.items():
        first, *_, last = means(rows, weight).values()
        found[weight] = {name: 100.0 * (1.0 - last[name] / first[name]) for name in effects}
    return found
