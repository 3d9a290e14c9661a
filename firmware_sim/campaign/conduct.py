"""The execution of a whole campaign: the missing runs are computed, and the outcome of every scenario is classified."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from typing import Any

from contract.config import loading
from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from contract.side_by_side import dask_client, spread
from firmware_sim.bench.simulation import Spans
from firmware_sim.campaign.folder import CAMPAIGN_SCHEMA, CampaignFolder, RunOutcome
from firmware_sim.campaign.judgement import PhaseOutcomes, ScenarioRow, judged
from firmware_sim.campaign.running import (
    RunTask,
    check_run,
    flow_disturbances,
    plant_of,
    run_task,
    seed_of,
    settings_of,
)
from firmware_sim.campaign.scenario import UNCONTROLLED, Scenario
from firmware_sim.campaign.starts import digest_of, keep_states, starting_states


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """A campaign to run. One of its scenarios is undisturbed. A scenario may override some of the settings that all
    runs share. `phases` runs of each scenario start at equal parts of a shedding cycle."""

    scenarios: tuple[Scenario, ...]
    bundle: Bundle
    config: Config
    timing: Spans
    phases: int = 3
    seed: int = 0

    def check(self) -> None:
        """Check every scenario. Raises StillwakeError with the scenario's name if no run of it is possible."""
        period = self.config.flow.control_period
        lead_in, total = self.timing.periods(period)
        # The last sample of a run is taken at the start of its last period, one period before the end of the run.
        if (latest := round((total - lead_in - 1) * period, 9)) < self.timing.settle:
            raise StillwakeError(
                f"--settle {self.timing.settle:g}: must be at most {latest:g} with --controlled "
                f"{self.timing.controlled:g}, or nothing is left to average"
            )
        controller = OnnxController.of(self.bundle)
        for scenario in self.scenarios:
            check_run(scenario, settings_of(scenario, self.config), self.bundle, self.timing, controller)

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
    """Compute the missing runs of a campaign, and reuse runs of an earlier call. Nothing is written before the first
    run has finished. Raises StillwakeError if the folder cannot be written, a starting state cannot be computed, or the
    workers (`contract.side_by_side.spread`) fail.

    Args:
        campaign: a campaign that has passed `Campaign.check`; its folder has passed `CampaignFolder.check`.
        progress: called with (runs done, total runs, name of the run just finished); before the first run it is called
            with (0, 0, text on the wake that is being computed).
    """
    if scheduler is not None:
        with dask_client(1, scheduler):
            pass  # the starts may take minutes, so errors are raised before them
    pairs = {scenario.name: _tasks(campaign, scenario) for scenario in campaign.scenarios}
    tasks = {task.name: task for found in pairs.values() for pair in found for task in pair}
    plants = {plant_of(campaign.config): ""}
    for name, found in pairs.items():
        plants.setdefault(found[0][0].plant, name)

    def developing(scenario: str, t: float, total: float) -> None:
        progress(0, 0, f"the wake of {scenario or 'all'}, {t:.0f} of {total:.0f} t_c")

    starts = {}
    for plant, scenario in plants.items():
        config = replace(campaign.config, flow=plant[0], body=plant[1])
        starts[plant] = starting_states(folder, config, campaign.phases, scenario, partial(developing, scenario))
    digests = {plant: [digest_of(state) for state in states] for plant, states in starts.items()}
    keys = {
        task.name: task.key(campaign.bundle.digest, digests[task.plant][task.phase], version("stillwake"))
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
            # A reused run may come from a campaign that is being replaced; its file was deleted with that campaign.
            folder.keep(name, outcome)

    def finished(task: RunTask, outcome: RunOutcome) -> None:
        claim()
        outcomes[task.name] = replace(outcome, key=keys[task.name])
        folder.keep(task.name, outcomes[task.name])
        progress(len(outcomes), len(tasks), task.name)

    progress(len(outcomes), len(tasks), "")
    spread(
        [task for name, task in tasks.items() if name not in reused],
        lambda task: (run_task, task, campaign.bundle, starts[task.plant][task.phase]),
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


def _tasks(campaign: Campaign, scenario: Scenario) -> list[tuple[RunTask, RunTask]]:
    """Return the runs of a scenario from each starting phase: without control in the same flow, and under control."""
    config, of_flow = settings_of(scenario, campaign.config), flow_disturbances(scenario.disturb)
    free_config = replace(campaign.config, flow=config.flow, body=config.body)
    is_changed = of_flow or plant_of(config) != plant_of(campaign.config)
    free_name = f"{scenario.name}.{UNCONTROLLED}" if is_changed else UNCONTROLLED
    pairs = []
    for phase in range(campaign.phases):
        name = f"{free_name}.phase{phase}"
        free = RunTask(
            name=name,
            disturb=of_flow,
            config=free_config,
            controlled=False,
            phase=phase,
            seed=seed_of(campaign.seed, name, phase),
            timing=campaign.timing,
        )
        under = replace(
            free,
            name=f"{scenario.name}.phase{phase}",
            disturb=scenario.disturb,
            config=config,
            controlled=True,
            seed=seed_of(campaign.seed, scenario.name, phase),
        )
        pairs.append((free, under))
    return pairs
