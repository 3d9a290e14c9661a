"""The execution of a campaign's run in any process: the loop under its disturbances, or the flow without control."""

from collections import Counter
from collections.abc import Iterable

import numpy as np

from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from contract.controller.interface import RunnableController
from contract.errors import ConfigError, StillwakeError
from contract.release.checks import Bundle
from firmware_sim.bench.disturbances import Disturbances, GustyWind, OtherBody, Reynolds
from firmware_sim.bench.disturbing import Disturbing
from firmware_sim.bench.invariants import Invariants
from firmware_sim.bench.simulation import Simulation
from firmware_sim.bench.spans import Spans
from firmware_sim.campaign.outcome import COURSE, MOST_KEPT, KeptCourse, MeanFigures, RunOutcome, RunService
from firmware_sim.campaign.scenario import Scenario
from firmware_sim.campaign.task import RunTask
from firmware_sim.runs.control import control
from firmware_sim.runs.run_log import RunLog
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake


def run_task(task: RunTask, bundle: Bundle, start: State) -> RunOutcome:
    """Run a task from a starting state. The outcome depends only on the arguments; the caller must set the outcome's
    key.

    An exception in a run does not end the campaign: the outcome records the exception as a result.
    """
    try:
        return _under_control(task, bundle, start) if task.controlled else _free(task, bundle, start)
    except StillwakeError as error:
        return RunOutcome(key="", failure=str(error))
    except Exception as error:  # noqa: BLE001  (that no exception leaves the ECU is one of the things under test)
        return RunOutcome(key="", failure=f"{type(error).__name__}: {error}")


def check_run(
    scenario: Scenario, config: Config, bundle: Bundle, timing: Spans, controller: RunnableController
) -> None:
    """Check a scenario. Raises ConfigError if no run of the scenario is possible; the error states the scenario."""
    try:
        Simulation(
            bundle,
            config,
            spans=timing,
            controller=controller,
            disturbances=Disturbances.parse(scenario.disturb),
        )
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
    samples = []
    with disturbing.in_flow(wake):
        for period in range(periods):
            disturbing.set_flow(period * config.period_ns)
            samples.append(wake.sample())
            wake.advance_to(config.flow.substeps, 0.0)
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
