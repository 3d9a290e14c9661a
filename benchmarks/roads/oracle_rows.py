"""Rows of the oracle by its horizon, and of the release on the same mesh.

A planning takes so many roll-outs of the flow over the horizon that a run is short: 25 t_c without control, then 50
with it, of which the last 25 count.
"""

from dataclasses import fields, replace
from typing import Final

import numpy as np

from benchmarks.common.command_line import progress as console
from benchmarks.common.parts import part
from benchmarks.roads.coarse import coarse, coarse_start
from benchmarks.roads.loop import Setting, through_can
from benchmarks.roads.oracle import Oracle, drive
from benchmarks.roads.row import Outcome, Row, outcome_of_series
from contract.arrays import Array
from contract.config.tree import Config
from contract.release import bundle as bundles
from contract.shipped import BUNDLE
from firmware_sim.bench.spans import Spans
from stillwake.console.terminal import progress_bar
from wake.plant.sample import Sample
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

SPANS: Final = Spans(lead_in=25.0, controlled=50.0, settle=25.0)
KNOTS: Final = {
    "oracle-25": (5, 10, 15, 20, 25),
    "oracle-50": (5, 10, 15, 20, 30, 40, 50),
    "oracle-100": (5, 10, 15, 20, 30, 40, 60, 80, 100),
}
"""A shedding cycle has 25 periods; further away a plan is coarser, since it will be made again before it acts."""
_SERIES: Final = tuple(item.name for item in fields(Sample) if item.name != "Cp")


def measure(road: str, setting: Setting) -> Row:
    """One of them."""
    if road == "release-coarse":
        return _release(road, setting)
    config = coarse(setting.config)
    oracle = _oracle(road, config)
    outcome = Outcome(**part(setting.folder / "outcome.json", lambda: vars(_run(road, oracle, setting, config))))
    lead_in, total = SPANS.periods(config.flow.control_period)
    plannings = -(-(total - lead_in) // oracle.every)
    return Row(
        road=road,
        title=f"oracle: MPC on the flow itself, horizon {oracle.horizon}",
        kind="oracle",
        outcomes=(outcome,),
        sensors=0,
        loop="plant",
        mesh=replace(setting, config=config).mesh,
        interactions=plannings * oracle.rollouts * oracle.horizon,
        note=(
            f"reads the whole flow; planned again every {oracle.every} periods, {oracle.rollouts} roll-outs, "
            f"{len(oracle.knots)} knots, the release's cost, no delay; the last {SPANS.controlled - SPANS.settle:g} of "
            f"{SPANS.controlled:g} t_c count"
        ),
    )


def _oracle(road: str, config: Config) -> Oracle:
    return Oracle(
        knots=KNOTS[road],
        every=5,
        difference=0.003,
        steps=(0.006, 0.018),
        iterations=1,
        limit=config.flow.action_limit,
        mpc=bundles.load(BUNDLE).manifest.mpc,
    )


def _run(road: str, oracle: Oracle, setting: Setting, config: Config) -> Outcome:
    wake = TruckWake(config.flow, body=config.body)
    lead_in, total = SPANS.periods(config.flow.control_period)
    free = without_control(wake, coarse_start(setting.folder.parent, config), lead_in)
    with progress_bar("periods", estimate_over=3600.0, console=console) as bar:
        task = bar.add_task(road, total=total - lead_in, note="")
        controlled = drive(
            wake,
            oracle,
            total - lead_in,
            series_row,
            setting.folder / "run.npz",
            wake.state(),
            lambda done, of: bar.update(task, completed=done),
        )
    series = np.concatenate([free, controlled])
    return outcome_of_series(named(series), enabled_at=lead_in, settle=SPANS.settle)


def without_control(wake: TruckWake, start: State, periods: int) -> Array:
    """(periods, m), `series_row` of the sample at every period's start; the wake is left at the end."""
    sample, rows = wake.reset(start), []
    for _ in range(periods):
        rows.append(series_row(sample))
        sample = wake.advance(0.0)
    return np.array(rows)


def series_row(sample: Sample) -> list[float]:
    """A sample's numbers without its pressures."""
    return [float(getattr(sample, name)) for name in _SERIES]


def named(series: Array) -> dict[str, Array]:
    """The columns of rows of `series_row`, by their names."""
    return {name: series[:, k] for k, name in enumerate(_SERIES)}


def _release(road: str, setting: Setting) -> Row:
    config = coarse(setting.config)
    release = bundles.load(BUNDLE)

    def run() -> dict[str, object]:
        start = coarse_start(setting.folder.parent, config)
        return vars(through_can(release, config, start, spans=SPANS))

    return Row(
        road=road,
        title="release, beside the oracle",
        kind="learned",
        outcomes=(Outcome(**part(setting.folder / "outcome.json", run)),),
        sensors=len(release.manifest.sensors),
        loop="CAN",
        mesh=replace(setting, config=config).mesh,
        note=f"on the oracle's mesh and over its time: the last {SPANS.controlled - SPANS.settle:g} t_c count",
    )
