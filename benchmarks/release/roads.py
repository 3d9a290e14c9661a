"""The release's rows in the table of ways to reduce drag: the shipped release, and its prior alone.

    python -m benchmarks roads [--json FILE]

The release's row has the results of `python -m benchmarks release-loop`. The prior alone is the same bundle in the same
loop with all cost weights at zero, so that the iterations change nothing. Rows of other ways stay as they are: their
studies are finished, and their code is in the history (version 0.9.0 and the commits up to b1dfcd12).
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer

from benchmarks.common.command_line import JsonFile, Parts, console, save, track
from benchmarks.common.commands import ROOT
from benchmarks.common.markdown import read
from benchmarks.common.parts import part
from benchmarks.release.release_loop import SPANS, kept_starts, measured, spread
from contract.config.controller import CostWeights
from contract.config.loading import load_config
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.results import versions
from contract.runtime.onnx_session import OnnxController
from contract.shipped import BUNDLE
from ecu.calibrating import release_calibration
from wake.solver.grid import box_grid

Tree = Mapping[str, Any]
STEPS: Final = 300
NOTHING: Final = CostWeights(**{item.name: 0.0 for item in fields(CostWeights)})


def main(
    json_file: JsonFile = None,
    parts: Parts = Path("runs/roads"),
    phases: Annotated[int, typer.Option(min=1, max=25, help="Starts of the prior alone, as of release-loop.")] = 3,
) -> None:
    """Measure both rows, and replace those in the file."""
    release = bundles.load(BUNDLE)
    of_loop = read(ROOT / "results" / "release_loop.json")
    config = load_config()
    kept = kept_starts(parts, release, phases, config)
    alone = replace(release_calibration(release, config), weights=NOTHING)
    runs = [
        part(kept.path / f"prior_{number}.json", partial(measured, release, config, kept.start(number), alone))
        for number in track(range(phases), "prior alone", "runs")
    ]
    rows = [
        row(release, "release", f"release: prior and MPC ({release.manifest.name})", of_loop["figures"]["phases"]),
        row(release, "prior-alone", "release's prior alone, no iterations", runs),
    ]
    before = read(json_file)["figures"] if json_file is not None and json_file.exists() else []
    kept_rows = [one for one in before if one["road"] not in {made["road"] for made in rows}]
    facts = {name: getattr(SPANS, name) for name in ("lead_in", "controlled", "settle")}
    facts |= {"versions": versions("stillwake", "numpy", "numba", "onnxruntime")}
    save(json_file, figures=[*kept_rows, *rows], facts=facts)
    for one in rows:
        console.print(f"{one['title']}: {one['reduction_percent']:.1f} %, mean |Cl| {one['abs_Cl']:.3f}")


def row(release: Bundle, road: str, title: str, runs: Sequence[Tree]) -> dict[str, Any]:
    """Compute a row of the table from the figures of runs."""
    training = read(ROOT / "results" / "refine.json")["figures"]
    over = {name: found["mean"] for name, found in spread(runs).items()}
    reduction = [run["reduction_percent"] for run in runs]
    return {
        "road": road,
        "title": title,
        "kind": "learned",
        "outcomes": list(runs),
        "sensors": release.manifest.sizes.sensors,
        "loop": "CAN",
        "mesh": list(box_grid(load_config().body.length).shape),
        "start": "developed",
        "interactions": training["periods"],
        "training_minutes": sum(one["cpu_min"] for one in training["phases"]),
        "step_ms": median_step_ms(release),
        "m7_ms": _m7_ms(release),
        "seeds": [0],
        "note": "interactions and minutes are of the prior, minutes with the plant's; the model is the recording's",
        "reduction_percent": over["reduction_percent"],
        "least_reduction_percent": min(reduction),
        "most_reduction_percent": max(reduction),
        "net_reduction_percent": over["net_reduction_percent"],
        "Cd": over["Cd_controlled"],
        "Cd_net": over["Cd_net_controlled"],
        "abs_Cl": over["abs_Cl_controlled"],
        "mean_Cl": over["mean_Cl_controlled"],
        "rms_action": over["rms_action"],
        "jet_power": over["jet_power_controlled"],
        "phases": len(runs),
    }


def _m7_ms(release: Bundle) -> float | None:
    """Return the modelled time of the whole ECU at 480 MHz in ms; None if the results are of another release."""
    found = read(ROOT / "results" / "mcu.json")["figures"]["release"]
    return float(found["modelled_ms_480"]) if found["bundle"] == release.manifest.name else None


def median_step_ms(release: Bundle) -> float:
    """Return the median CPU time in ms of a control step in ONNX Runtime; other processes hardly affect it."""
    controller, sizes = OnnxController.of(release), release.manifest.sizes
    controller.warm_up(10)
    generator, taken = np.random.default_rng(0), []
    plan, free = np.zeros(sizes.horizon), np.ones(sizes.horizon)
    free[0] = 0.0
    for _ in range(STEPS):
        window = 0.1 * generator.standard_normal((sizes.window, sizes.sensors + 1)) - 0.3
        before = time.process_time()
        plan = controller.control_step(window, plan, free).plan
        taken.append(1e3 * (time.process_time() - before))
    return float(np.median(taken))
