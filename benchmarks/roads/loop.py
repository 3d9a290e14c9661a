"""The two ways to close a loop for the table: through bus and ECU, or straight on the plant, a period late as there."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from benchmarks.common.parts import part
from benchmarks.roads.coarse import coarse_starts
from benchmarks.roads.row import Outcome, outcome_of_log, outcome_of_samples
from contract.arrays import Array
from contract.config.tree import Config
from contract.controller.interface import FORCES, TERMS, Controller, ControlStep, RunnableController
from contract.release.checks import Bundle
from contract.release.manifest import Manifest
from firmware_sim.bench.simulation import simulate
from firmware_sim.bench.spans import Spans
from firmware_sim.campaign.folder import CampaignFolder
from firmware_sim.campaign.starts import keep_states, starting_states
from wake.plant.sample import Sample
from wake.solver.grid import box_grid
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

SPANS: Final = Spans(lead_in=25.0, controlled=100.0, settle=40.0)
"""Spans of every row: the last 60 t_c count."""
MIRROR_SENSORS: Final = ("upper_39", "lower_39", "base_0", "base_9")
"""Two pairs that the axis mirrors, so that differences within them vanish in a symmetric flow."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What a road is measured with.

    Attributes:
        folder: for its finished parts; it exists.
        config: the vehicle.
        phases: of the shedding cycle, from which rows begin where it decides something.
        budget: multiplies what a road may spend on tuning and learning where that is a choice.
    """

    folder: Path
    config: Config
    phases: int
    budget: float = 1.0

    def starts(self) -> Sequence[State]:
        """Developed wakes in these phases, kept next to the roads' folders."""
        if self.config.flow.refinement != 1.0:
            return coarse_starts(self.folder.parent, self.config, self.phases)
        kept = CampaignFolder(self.folder.parent / f"starts_{self.phases}")
        kept.start(0).parent.mkdir(parents=True, exist_ok=True)
        states = starting_states(kept, self.config, self.phases)
        keep_states(kept, states)
        return states

    def outcomes(self, run: Callable[[State], Outcome], name: str = "phase") -> tuple[Outcome, ...]:
        """What the run found from every phase; each is kept under that name, and found again."""
        mesh = "" if self.config.flow.refinement == 1.0 else f"_{self.config.flow.refinement:g}"
        return tuple(
            Outcome(**part(self.folder / f"{name}{mesh}_{number}.json", partial(_as_tree, run, start)))
            for number, start in enumerate(self.starts())
        )

    @property
    def mesh(self) -> tuple[int, int]:
        """Cells of the wake's grid."""
        return box_grid(self.config.body.length, self.config.flow.refinement).shape


def _as_tree(run: Callable[[State], Outcome], start: State) -> dict[str, Any]:
    return asdict(run(start))


class Law(Protocol):
    """A controller as a function of what the ECU remembers."""

    def __call__(self, window: Array, committed: float) -> float:
        """The action for the period after the one that begins now, in U_inf W.

        Args:
            window: (L, S+1), oldest row first; row k is (Cp_k, a_{k-1}).
            committed: action a_k, which the jets follow in the period that begins now.
        """
        ...


class LawController:
    """A law as the ECU's controller: its plan is the committed action, then the law's for ever.

    It forecasts nothing; the forecast that the interface wants is zero.

    Args:
        horizon: of the manifest.
        limit: to which the action is cut, U_inf W.
    """

    def __init__(self, law: Law, *, horizon: int, limit: float, description: str) -> None:
        self.description = description
        self._law, self._horizon, self._limit = law, horizon, limit

    def warm_up(self, steps: int) -> None:
        """Nothing happens once."""

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> ControlStep:
        """As the interface's."""
        # The interface's plan is the last one; its second action is this period's.
        committed = float(plan[1])
        action = float(np.clip(self._law(window, committed), -self._limit, self._limit))
        new = np.full(self._horizon, action)
        new[0] = committed
        return ControlStep(plan=new, forces=np.zeros((self._horizon, FORCES)), terms=np.zeros(len(TERMS)), cost=0.0)


def mounted(bundle: Bundle, sensors: Sequence[str], window: int) -> Bundle:
    """The bundle of a vehicle with other sensors and another memory, for a controller that is not the bundle's own.

    Without the check of the sensors, whose estimator is of the bundle's.
    """
    manifest = bundle.manifest
    scaling = replace(manifest.scaling, pressure_mean=(0.0,) * len(sensors), pressure_std=(1.0,) * len(sensors))
    changed: Manifest = replace(
        manifest,
        sensors=tuple(sensors),
        window=window,
        scaling=scaling,
        sensor_positions=None,
        sensor_estimator=None,
    )
    return replace(bundle, manifest=changed)


def through_can(
    bundle: Bundle,
    config: Config,
    start: State,
    controller: RunnableController | None = None,
    spans: Spans = SPANS,
) -> Outcome:
    """A run as `stillwake run` makes it, from that flow.

    Args:
        controller: in place of the bundle's own.
    """
    wake = TruckWake(config.flow, body=config.body)
    wake.reset(start)
    fitting = replace(config, mpc=bundle.manifest.mpc)
    return outcome_of_log(simulate(bundle, fitting, spans=spans, wake=wake, controller=controller))


class SteppedPlant(Protocol):
    """What a loop without a bus needs of a flow."""

    def sample(self) -> Sample:
        """Measure now."""

    def advance(self, action: float) -> Sample:
        """Ramp to the action over a control period; the sample at its end."""


class Feedback(Protocol):
    """A controller that sees whatever it wants of the plant; it keeps what it remembers."""

    def see(self, sample: Sample) -> None:
        """Take note of this period's sample, with or without control."""

    def command(self, committed: float) -> float:
        """The action for the period after the one that begins now; `committed` is that of this one. In U_inf W."""


def on_plant(
    plant: SteppedPlant,
    feedback: Feedback,
    *,
    spans: Spans,
    control_period: float,
    limit: float,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[Sample], int]:
    """A loop without bus: what is commanded from sample k acts from sample k+1 on, as with `ecu.plan_ahead`.

    Args:
        plant: at the start of a control period.
        limit: to which commands are cut, U_inf W.

    Returns:
        The samples, one a period, and the index of the one at which control was requested.
    """
    lead_in, total = spans.periods(control_period)
    samples, committed = list[Sample](), 0.0
    for k in range(total):
        samples.append(plant.sample())
        feedback.see(samples[-1])
        commanded = feedback.command(committed) if k >= lead_in else 0.0
        plant.advance(committed)
        committed = float(np.clip(commanded, -limit, limit))
        progress(k + 1, total)
    return samples, lead_in


def plant_outcome(config: Config, start: State, feedback: Feedback, spans: Spans = SPANS) -> Outcome:
    """`on_plant` on the wake from that flow."""
    wake = TruckWake(config.flow, body=config.body)
    wake.reset(start)
    samples, enabled = on_plant(
        wake,
        feedback,
        spans=spans,
        control_period=config.flow.control_period,
        limit=config.flow.action_limit,
    )
    return outcome_of_samples(samples, enabled, spans.settle)


def controller_law(controller: Controller, horizon: int) -> Law:
    """A controller of the ECU's interface as a law that plans a period ahead; it keeps its plan."""
    plan, free = np.zeros(horizon), np.ones(horizon)
    free[0] = 0.0

    def law(window: Array, committed: float) -> float:
        plan[1] = committed
        plan[:] = controller.control_step(window, plan, free).plan
        return float(plan[1])

    return law
