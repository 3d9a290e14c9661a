"""The execution of a campaign: it computes the missing runs, and classifies the outcome of every scenario."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from importlib.metadata import version
from typing import Any, Final

import numpy as np

from can_bridge.wire.messages import Mode, Reason
from contract.config import loading
from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import ConfigError, StillwakeError
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from contract.side_by_side import dask_client, spread
from firmware_sim.bench.disturbances import Disturbances, GustyWind, OtherBody, Reynolds
from firmware_sim.bench.disturbing import Disturbing, uncontrolled
from firmware_sim.bench.invariants import Invariants
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.campaign.folder import (
    CAMPAIGN_SCHEMA,
    COURSE,
    CampaignFolder,
    KeptCourse,
    MeanFigures,
    RunOutcome,
    RunService,
    keep_states,
    starting_states,
)
from firmware_sim.campaign.judgement import PhaseOutcomes, ScenarioRow, judged
from firmware_sim.campaign.scenario import UNCONTROLLED, Scenario
from firmware_sim.runs.control import control
from firmware_sim.runs.run_log import RunLog
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

_SETTINGS: Final = ("bus", "ecu", "vehicle", "flow.reynolds", "flow.substeps")
"""Sections and settings that a scenario may change. The release fixes the controller and its period in t_c."""
_MOST_KEPT: Final = 20  # largest number of violations that are stored as text; all violations are counted
MARGIN_PERIODS: Final = 2
"""Number of periods that the lead-in needs in addition to those that fill the window; the first frames add no row."""


@dataclass(frozen=True, kw_only=True)
class RunTask:
    """The data of one run, with the name of its file. If `controlled` is False, the flow runs without the loop. The
    plant has the body in `config`; the release's body may differ. `phase` is the index of the starting phase."""

    name: str
    disturb: tuple[str, ...]
    config: Config
    controlled: bool
    phase: int
    seed: int
    timing: Spans

    def key(self, bundle_digest: str, start_digest: str, program_version: str) -> str:
        """Return the hash, as hexadecimal digits, of everything that the run depends on."""
        deciding: dict[str, Any] = {
            "disturb": list(self.disturb),
            "config": loading.to_tree(self.config),
            "controlled": self.controlled,
            "seed": self.seed,
            "timing": [self.timing.lead_in, self.timing.controlled, self.timing.settle],
            "bundle": bundle_digest,
            "start": start_digest,
            "version": program_version,
        }
        return sha256(json.dumps(deciding, sort_keys=True).encode()).hexdigest()


def plant_of(config: Config) -> tuple[FlowConfig, BodyConfig]:
    """Return the settings that a starting state has to match."""
    return config.flow, config.body


def settings_of(scenario: Scenario, config: Config) -> Config:
    """Return the campaign's settings with the changes of the scenario: its settings, and the body of its plant. Raises
    ConfigError with the scenario's name if a setting is unknown, wrong, or not allowed in a scenario."""
    try:
        loaded = loading.load(None, scenario.settings, base=config)
        plant = Disturbances.parse(scenario.disturb).plant(loaded.config)
    except ConfigError as error:
        raise ConfigError(f"scenario {scenario.name!r}: {error}") from error
    for name in sorted(loaded.in_overrides):
        if not {name, name.partition(".")[0]} & set(_SETTINGS):
            rule = f"a scenario can set only {', '.join(_SETTINGS)}; for all runs, use --set"
            raise ConfigError(f"scenario {scenario.name!r}: {name}: {rule}")
    return plant


def seed_of(seed: int, name: str, phase: int) -> int:
    """Return a run's seed, which depends only on the campaign's seed, the run's name and its phase."""
    return int.from_bytes(sha256(f"{seed}/{name}/{phase}".encode()).digest()[:4])


def run_task(task: RunTask, bundle: Bundle, start: State) -> RunOutcome:
    """Run a task from a starting state. The outcome records any exception; the caller sets the outcome's key."""
    try:
        return _under_control(task, bundle, start) if task.controlled else _free(task, bundle, start)
    except StillwakeError as error:
        return RunOutcome(key="", failure=str(error))
    except Exception as error:  # noqa: BLE001  (a run also tests that the ECU raises no exception)
        return RunOutcome(key="", failure=f"{type(error).__name__}: {error}")


def flow_disturbances(texts: Iterable[str]) -> tuple[str, ...]:
    """Return the texts of the disturbances that act on the flow, and thus also in the runs without control."""
    disturbances = Disturbances.parse(texts)
    both = zip(disturbances.texts, disturbances.items, strict=True)
    return tuple(text for text, one in both if isinstance(one, GustyWind | OtherBody | Reynolds))


def _under_control(task: RunTask, bundle: Bundle, start: State) -> RunOutcome:
    disturbances = Disturbances.parse(task.disturb)
    observer = Invariants.of(task.config, disturbances)
    simulation = Simulation(bundle, task.config, spans=task.timing, disturbances=disturbances, seed=task.seed)
    log = simulation.run(_wake(task, start), observer=observer)
    enabled_t = float(log.series["t"][log.enabled_at])
    course = KeptCourse.of(log.series, enabled_t)
    broken = [f"period {one.period}: {one.invariant}: {one.detail}" for one in observer.violations]
    figures = MeanFigures.over(course, enabled_t + task.timing.settle)
    return RunOutcome(key="", figures=figures, course=course, service=_service(log, broken))


def _free(task: RunTask, bundle: Bundle, start: State) -> RunOutcome:
    config, wake = task.config, _wake(task, start)
    lead_in, periods = task.timing.periods(config.flow.control_period)
    disturbing = Disturbing(Disturbances.parse(task.disturb), config, bundle.manifest.sensors, task.seed, {})
    samples = list(uncontrolled(wake, disturbing, config, periods))
    series = {name: np.array([getattr(sample, name) for sample in samples]) for name in COURSE}
    enabled_t = samples[lead_in].t
    course = KeptCourse.of(series, enabled_t)
    return RunOutcome(key="", figures=MeanFigures.over(course, enabled_t + task.timing.settle), course=course)


def _wake(task: RunTask, start: State) -> TruckWake:
    wake = TruckWake(task.config.flow, body=task.config.body)
    wake.reset(start)
    return wake


def _service(log: RunLog, broken: list[str]) -> RunService:
    held = control(log)
    modes = log.series["mode"][log.enabled_at + held.warm_up :].astype(int)
    reasons = log.series["reason"][log.enabled_at + held.warm_up :].astype(int)
    before = np.concatenate([[Mode.OFF], modes[:-1]])
    out_of_control = reasons[modes != Mode.CONTROL]
    return RunService(
        requested=held.requested - held.warm_up,
        in_control=held.in_control,
        latches=int(np.count_nonzero((modes == Mode.FAULT) & (before != Mode.FAULT))),
        reasons=dict(sorted(Counter(Reason(reason).name for reason in out_of_control.tolist()).items())),
        frames_sent=log.bus.sent,
        frames_lost=log.bus.lost,
        frames_rejected=log.bus.rejected,
        violations=len(broken),
        broken=broken[:_MOST_KEPT],
    )


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """A campaign to run. One of its scenarios is undisturbed. A scenario may override some of the settings that all
    runs share. Each scenario runs `phases` times, from starting phases spread evenly over a shedding cycle."""

    scenarios: tuple[Scenario, ...]
    bundle: Bundle
    config: Config
    timing: Spans
    phases: int = 3
    seed: int = 0

    def check(self) -> None:
        """Check every scenario. Raises StillwakeError with the scenario's name if a scenario cannot run."""
        period = self.config.flow.control_period
        lead_in, total = self.timing.periods(period)
        # The last sample of a run is taken at the start of its last period, one period before the end of the run.
        if (latest := round((total - lead_in - 1) * period, 9)) < self.timing.settle:
            rule = f"must be at most {latest:g} with --controlled {self.timing.controlled:g}"
            raise StillwakeError(f"--settle {self.timing.settle:g}: {rule}, or nothing is left to average")
        controller = OnnxController.of(self.bundle)
        for scenario in self.scenarios:
            config = settings_of(scenario, self.config)
            try:
                disturbances = Disturbances.parse(scenario.disturb)
                Simulation(self.bundle, config, spans=self.timing, controller=controller, disturbances=disturbances)
            except StillwakeError as error:
                raise ConfigError(f"scenario {scenario.name!r}: {error}") from error

    def label(self) -> dict[str, Any]:
        """Return the data that identify this campaign, as plain JSON. The data do not include the scenarios."""
        return {
            "schema": CAMPAIGN_SCHEMA,
            "version": version("stillwake"),
            "bundle": self.bundle.digest,
            "seed": self.seed,
            "phases": self.phases,
            **{name: getattr(self.timing, name) for name in ("lead_in", "controlled", "settle")},
            "settings": loading.to_tree(self.config),
        }


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of a campaign: its rows, and the numbers of runs that this call computed and found in the folder."""

    rows: tuple[ScenarioRow, ...]
    made: int
    kept: int

    @property
    def safe(self) -> bool:
        return all(row.safe for row in self.rows)


def conduct(
    campaign: Campaign,
    folder: CampaignFolder,
    *,
    workers: int,
    scheduler: str | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> Result:
    """Compute the missing runs of a campaign that has passed `Campaign.check` and `CampaignFolder.check`; reuse the
    runs of an earlier call. Nothing is written before the first run has finished. `progress` is called with (runs done,
    total runs, name of the run just finished), and before the first run with (0, 0, text about the wake in work).
    Raises StillwakeError if the folder cannot be written, or a starting state or the workers (`spread`) fail."""
    if scheduler is not None:
        with dask_client(1, scheduler):
            pass  # tests the connection now, because the initial states may take minutes
    pairs = {scenario.name: list(_tasks(campaign, scenario)) for scenario in campaign.scenarios}
    tasks = {task.name: task for found in pairs.values() for pair in found for task in pair}
    plants = {plant_of(campaign.config): ""}
    for name, found in pairs.items():
        plants.setdefault(plant_of(found[0][0].config), name)

    def developing(scenario: str, t: float, total: float) -> None:
        progress(0, 0, f"the wake of {scenario or 'all'}, {t:.0f} of {total:.0f} t_c")

    # States of a campaign with other phases or settings do not fit; the present call replaces such a campaign.
    kept, starts = folder if folder.has_starts_of(campaign.label()) else None, {}
    for plant, scenario in plants.items():
        config = replace(campaign.config, flow=plant[0], body=plant[1])
        starts[plant] = starting_states(kept, config, campaign.phases, scenario, partial(developing, scenario))
    digests = {plant: [sha256(one.flat.tobytes()).hexdigest() for one in states] for plant, states in starts.items()}
    keys = {
        task.name: task.key(campaign.bundle.digest, digests[plant_of(task.config)][task.phase], version("stillwake"))
        for task in tasks.values()
    }
    reused = {name: outcome for name, key in keys.items() if (outcome := folder.outcome(name, key)) is not None}
    outcomes = dict(reused)

    def claim() -> None:
        """Write the campaign's label, initial states and reused runs into the folder, before any new run is written."""
        if len(outcomes) > len(reused):
            return
        folder.claim(campaign.label())
        for plant, scenario in plants.items():
            keep_states(folder, starts[plant], scenario)
        for name, outcome in reused.items():
            # If another campaign is replaced, `folder.claim` has just deleted the files of the runs that are reused.
            folder.keep(name, outcome)

    def finished(task: RunTask, outcome: RunOutcome) -> None:
        claim()
        outcomes[task.name] = replace(outcome, key=keys[task.name])
        folder.keep(task.name, outcomes[task.name])
        progress(len(outcomes), len(tasks), task.name)

    progress(len(outcomes), len(tasks), "")
    spread(
        [task for name, task in tasks.items() if name not in reused],
        lambda task: (run_task, task, campaign.bundle, starts[plant_of(task.config)][task.phase]),
        workers=workers,
        scheduler=scheduler,
        names=lambda task: (f"run {task.name}", "finished runs are stored"),
        finished=finished,
        slots=lambda threads: sum(threads.values()),
    )
    claim()
    phases = {
        scenario: [PhaseOutcomes(under=outcomes[under.name], free=outcomes[free.name]) for free, under in found]
        for scenario, found in pairs.items()
    }
    return Result(rows=judged(campaign.scenarios, phases), made=len(tasks) - len(reused), kept=len(reused))


def _tasks(campaign: Campaign, scenario: Scenario) -> Iterator[tuple[RunTask, RunTask]]:
    """Yield the runs of a scenario from each starting phase: without control in the same flow, and under control."""
    config, of_flow = settings_of(scenario, campaign.config), flow_disturbances(scenario.disturb)
    free_config = replace(campaign.config, flow=config.flow, body=config.body)
    is_changed = of_flow or plant_of(config) != plant_of(campaign.config)
    free_name = f"{scenario.name}.{UNCONTROLLED}" if is_changed else UNCONTROLLED
    for phase in range(campaign.phases):
        name, timing = f"{free_name}.phase{phase}", campaign.timing
        seed = seed_of(campaign.seed, name, phase)
        free = RunTask(
            name=name, disturb=of_flow, config=free_config, controlled=False, phase=phase, seed=seed, timing=timing
        )
        name, seed = f"{scenario.name}.phase{phase}", seed_of(campaign.seed, scenario.name, phase)
        yield free, replace(free, name=name, disturb=scenario.disturb, config=config, controlled=True, seed=seed)
