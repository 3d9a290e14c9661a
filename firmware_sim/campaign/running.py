"""One run of a campaign, with the loop or without control. Any process can execute the run from its data."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from can_bridge.wire.messages import Mode, Reason
from contract.config import loading
from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.controller.interface import RunnableController
from contract.errors import ConfigError, StillwakeError
from contract.release.checks import Bundle
from firmware_sim.bench.disturbances import Disturbances, GustyWind, OtherBody, Reynolds
from firmware_sim.bench.disturbing import Disturbing
from firmware_sim.bench.driven import uncontrolled
from firmware_sim.bench.invariants import Invariants
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.campaign.folder import COURSE, MOST_KEPT, KeptCourse, MeanFigures, RunOutcome, RunService
from firmware_sim.campaign.scenario import Scenario
from firmware_sim.runs.control import control
from firmware_sim.runs.run_log import RunLog
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

_SETTINGS: Final = ("operating_point", "bus", "ecu", "vehicle", "flow.reynolds", "flow.substeps")
"""Sections and settings that a scenario may change. The controller and its period in t_c are fixed by the release."""
PlantKey = tuple[FlowConfig, BodyConfig]

MARGIN_PERIODS: Final = 2
"""Number of periods without control that a run needs beyond the controller's window: the first frame adds no row."""


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

    @property
    def plant(self) -> PlantKey:
        """Key under which the initial states of the run's plant are stored."""
        return plant_of(self.config)

    def key(self, bundle_digest: str, start_digest: str, version: str) -> str:
        """Return the hash of everything that the run depends on, in hex."""
        deciding: dict[str, Any] = {
            "disturb": list(self.disturb),
            "config": loading.to_tree(self.config),
            "controlled": self.controlled,
            "seed": self.seed,
            "timing": [self.timing.lead_in, self.timing.controlled, self.timing.settle],
            "bundle": bundle_digest,
            "start": start_digest,
            "version": version,
        }
        return hashlib.sha256(json.dumps(deciding, sort_keys=True).encode()).hexdigest()


def plant_of(config: Config) -> PlantKey:
    """Return the settings that a starting state has to match."""
    return config.flow, config.body


def settings_of(scenario: Scenario, config: Config) -> Config:
    """Return the campaign's settings, changed by the scenario's settings and its plant's body. Raises ConfigError
    with the scenario's name if a setting is unknown, wrong, or not allowed in a scenario."""
    try:
        loaded = loading.load(None, scenario.settings, base=config)
        plant = Disturbances.parse(scenario.disturb).plant(loaded.config)
    except ConfigError as error:
        raise ConfigError(f"scenario {scenario.name!r}: {error}") from error
    for name in sorted(loaded.in_overrides):
        if not {name, name.partition(".")[0]} & set(_SETTINGS):
            raise ConfigError(
                f"scenario {scenario.name!r}: {name}: a scenario sets {', '.join(_SETTINGS)}; give --set for all runs"
            )
    return plant


def seed_of(seed: int, name: str, phase: int) -> int:
    """Return a run's seed, which depends only on the campaign's seed, the run's name and its phase."""
    return int.from_bytes(hashlib.sha256(f"{seed}/{name}/{phase}".encode()).digest()[:4])


def run_task(task: RunTask, bundle: Bundle, start: State) -> RunOutcome:
    """Run a task from a starting state. The outcome records any exception; the caller sets the outcome's key."""
    try:
        return _under_control(task, bundle, start) if task.controlled else _free(task, bundle, start)
    except StillwakeError as error:
        return RunOutcome(key="", failure=str(error))
    except Exception as error:  # noqa: BLE001  (that no exception leaves the ECU is one of the things under test)
        return RunOutcome(key="", failure=f"{type(error).__name__}: {error}")


def check_run(
    scenario: Scenario, config: Config, bundle: Bundle, timing: Spans, controller: RunnableController
) -> None:
    """Raise ConfigError with the scenario's name if no run of the scenario is possible."""
    try:
        disturbances = Disturbances.parse(scenario.disturb)
        Simulation(bundle, config, spans=timing, controller=controller, disturbances=disturbances)
    except StillwakeError as error:
        raise ConfigError(f"scenario {scenario.name!r}: {error}") from error


def flow_disturbances(texts: Iterable[str]) -> tuple[str, ...]:
    """Return the texts of the disturbances that act on the flow; these act in the runs without control as well."""
    disturbances = Disturbances.parse(texts)
    return tuple(
        text
        for text, one in zip(disturbances.texts, disturbances.items, strict=True)
        if isinstance(one, GustyWind | OtherBody | Reynolds)
    )


def _under_control(task: RunTask, bundle: Bundle, start: State) -> RunOutcome:
    disturbances = Disturbances.parse(task.disturb)
    observer = Invariants.of(task.config, disturbances)
    simulation = Simulation(bundle, task.config, spans=task.timing, disturbances=disturbances, seed=task.seed)
    log = simulation.run(_wake(task, start), observer=observer)
    enabled_t = float(log.series["t"][log.enabled_at])
    course = KeptCourse.of(log.series, enabled_t)
    broken = [f"period {one.period}: {one.invariant}: {one.detail}" for one in observer.violations]
    return RunOutcome(
        key="",
        figures=MeanFigures.over(course, enabled_t + task.timing.settle),
        course=course,
        service=_service(log, broken),
    )


def _free(task: RunTask, bundle: Bundle, start: State) -> RunOutcome:
    """Run the flow without control, for the length of a run under control."""
    config, wake = task.config, _wake(task, start)
    lead_in, periods = task.timing.periods(config.flow.control_period)
    disturbing = Disturbing(Disturbances.parse(task.disturb), config, bundle.manifest.sensors, task.seed)
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
        broken=broken[:MOST_KEPT],
    )
