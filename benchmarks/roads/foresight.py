"""The release, corrected by what the flow itself will do: whether the plateau is the wake's or the controller's.

Every few periods the plant is stepped some way ahead from where it stands, under the release's controller, once as it
is and once with each of some offsets added to its first commands; the offset of least mean drag is taken, and the
plant is put back and goes on. Such a one-step improvement of a policy by roll-outs is never worse than the policy in
its own forecast (Bertsekas, Dynamic Programming and Optimal Control, "rollout algorithm"). It reads the whole flow: no
vehicle can do this.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.common.command_line import progress as console
from benchmarks.common.parts import part
from benchmarks.roads.coarse import coarse, coarse_start
from benchmarks.roads.loop import Setting
from benchmarks.roads.oracle import Model
from benchmarks.roads.oracle_rows import named, series_row, without_control
from benchmarks.roads.row import Outcome, Row, outcome_of_series
from contract.arrays import Array
from contract.atomic import replacing
from contract.config.tree import Config
from contract.release import bundle as bundles
from contract.shipped import BUNDLE
from firmware_sim.bench.spans import Spans
from firmware_sim.ecu.bundle_policy import BundlePolicy
from stillwake.console.terminal import progress_bar
from wake.plant.sample import Sample
from wake.recording.feedback import Policy
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

SPANS: Final = Spans(lead_in=25.0, controlled=80.0, settle=55.0)
OFFSETS: Final = (0.0, -0.03, -0.012, 0.012, 0.03)
"""Added to the release's commands, in U_inf W; the first one stands where none is better."""
HORIZONS: Final = {"foresight-25": 25, "foresight-50": 50, "foresight-100": 100}
"""Periods; a shedding cycle has 25."""
EVERY: Final = 5
"""Periods from one choice to the next."""
LIFT_PRICE: Final = 0.02
"""Weight of mean |Cl| against mean Cd in a forecast, so that no drag is bought with a deflected wake."""


@dataclass(frozen=True, kw_only=True)
class Foresight:
    """How it looks ahead.

    Attributes:
        policy: what is corrected, and what acts after the correction.
        offsets: that are tried, U_inf W.
        every: periods that an offset lasts, and from one choice to the next.
        horizon: periods that a forecast is long.
        limit: of the action.
    """

    policy: Policy
    offsets: Sequence[float]
    every: int
    horizon: int
    limit: float

    def step(self, plant: Model, sample: Sample, memory: Array, offset: float) -> tuple[Sample, Array]:
        """One period of the policy, with the offset added to its command."""
        command, memory = self.policy.step(memory, sample.Cp, sample.action)
        return plant.advance(float(np.clip(command + offset, -self.limit, self.limit))), memory

    def forecast(self, plant: Model, start: State, memory: Array, offset: float) -> float:
        """Mean Cd and price of |Cl| over the horizon; the plant is left somewhere."""
        sample, cost = plant.reset(start), 0.0
        for k in range(self.horizon):
            sample, memory = self.step(plant, sample, memory, offset if k < self.every else 0.0)
            cost += sample.Cd + LIFT_PRICE * abs(sample.Cl)
        return cost / self.horizon

    def choice(self, plant: Model, memory: Array) -> tuple[float, float]:
        """The best offset from where the plant stands, where it is put back, and its forecast."""
        start = plant.state()
        forecasts = [self.forecast(plant, start, memory, offset) for offset in self.offsets]
        plant.reset(start)
        best = int(np.argmin(forecasts))
        return self.offsets[best], forecasts[best]


def drive(
    plant: Model,
    foresight: Foresight,
    periods: int,
    kept: Path,
    origin: State,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Array:
    """Control the plant for so many periods; a stopped run goes on from its last choice.

    Args:
        kept: file of a stopped run.
        origin: where the run begins; a kept one goes on with its origin.

    Returns:
        (periods, m), `series_row` of the sample at every period's start.
    """
    memory, rows, state = foresight.policy.start(), list[Sequence[float]](), origin
    if kept.exists():
        with np.load(kept) as data:
            memory, rows = data["memory"], [tuple(row) for row in data["series"]]
            state = replace(origin, flat=data["flat"], substep=int(data["substep"]), action=float(data["action"]))
    sample = plant.reset(state)
    while len(rows) < periods:
        offset, _ = foresight.choice(plant, memory)
        for _ in range(foresight.every):
            rows.append(series_row(sample))
            sample, memory = foresight.step(plant, sample, memory, offset)
        _keep(kept, plant.state(), memory, np.array(rows))
        progress(min(len(rows), periods), periods)
    return np.array(rows[:periods])


def measure(road: str, setting: Setting) -> Row:
    """The row: on the coarse mesh, one run."""
    config, horizon = coarse(setting.config), HORIZONS[road]
    outcome = Outcome(**part(setting.folder / "outcome.json", lambda: asdict(_run(setting, config, horizon))))
    lead_in, total = SPANS.periods(config.flow.control_period)
    choices = -(-(total - lead_in) // EVERY)
    return Row(
        road=road,
        title=f"oracle: release corrected by roll-outs of the flow, {horizon} periods",
        kind="oracle",
        outcomes=(outcome,),
        sensors=0,
        loop="plant",
        mesh=replace(setting, config=config).mesh,
        interactions=choices * len(OFFSETS) * horizon,
        note=(
            f"reads the whole flow; one of {len(OFFSETS)} offsets every {EVERY} periods; no delay; the last "
            f"{SPANS.controlled - SPANS.settle:g} of {SPANS.controlled:g} t_c count"
        ),
    )


def _run(setting: Setting, config: Config, horizon: int) -> Outcome:
    wake = TruckWake(config.flow, body=config.body)
    lead_in, total = SPANS.periods(config.flow.control_period)
    free = without_control(wake, coarse_start(setting.folder.parent, config), lead_in)
    foresight = Foresight(
        policy=BundlePolicy(bundles.load(BUNDLE), layout=wake.layout),
        offsets=OFFSETS,
        every=EVERY,
        horizon=horizon,
        limit=config.flow.action_limit,
    )
    with progress_bar("periods", estimate_over=3600.0, console=console) as bar:
        task = bar.add_task(f"foresight of {horizon}", total=total - lead_in, note="")
        controlled = drive(
            wake,
            foresight,
            total - lead_in,
            setting.folder / "run.npz",
            wake.state(),
            lambda done, of: bar.update(task, completed=done),
        )
    return outcome_of_series(named(np.concatenate([free, controlled])), lead_in, SPANS.settle)


def _keep(path: Path, state: State, memory: Array, series: Array) -> None:
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, flat=state.flat, substep=state.substep, action=state.action, memory=memory, series=series)
