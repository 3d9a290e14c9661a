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
from contract.side_by_side import spread
from firmware_sim.bench.spans import Spans
from firmware_sim.campaign.folder import CAMPAIGN_SCHEMA, CampaignFolder
from firmware_sim.campaign.judgement import PhaseOutcomes, ScenarioRow, judged
from firmware_sim.campaign.outcome import RunOutcome
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
    """A campaign to run.

    Attributes:
        scenarios: scenarios of the plan, among them the undisturbed scenario.
        config: settings of all runs; each scenario may override some of them.
        phases: number of runs under control for each scenario. The runs start in phases that divide a shedding cycle
            into equal parts.
    """

    scenarios: tuple[Scenario, ...]
    bundle: Bundle
    config: Config
    timing: Spans
    phases: int = 3
    seed: int = 0

    def check(self) -> None:
        """Check every scenario. Raises StillwakeError if no run of a scenario is possible; the error states the
        scenario."""
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
            "lead_in": self.timing.lead_in,
            "controlled": self.timing.controlled,
            "settle": self.timing.settle,
            "settings": loading.to_tree(self.config),
        }


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of a campaign.

    Attributes:
        rows: one row per scenario, in the plan's order.
        made: number of runs that this call computed.
        kept: number of runs that were already in the folder.
    """

    rows: tuple[ScenarioRow, ...]
    made: int
    kept: int

    @property
    def safe(self) -> bool:
        """Whether all scenarios are safe."""
        return all(row.safe for row in self.rows)


def conduct(
    campaign: Campaign,
    folder: CampaignFolder,
    *,
    workers: int,
    scheduler: str | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> Result:
    """Compute the missing runs of a campaign; finished runs of an earlier call are reused. Nothing is written before
    the first run has finished. Raises StillwakeError if the folder cannot be written, a starting state cannot be
    computed, or the workers fail.

    Args:
        campaign: a campaign that has passed `Campaign.check`; its folder has passed `CampaignFolder.check`.
        workers, scheduler: see `contract.side_by_side.spread`.
        progress: called with (runs done, total runs, name of the run just finished); before the first run it is called
            with (0, 0, text on the wake that is being computed).
    """
    runs = _Runs(campaign, folder, progress)
    runs.run(workers, scheduler)
    runs.claim()
    return Result(rows=runs.rows(), made=runs.made, kept=runs.kept)


class _Runs:
    def __init__(self, campaign: Campaign, folder: CampaignFolder, progress: Callable[[int, int, str], None]) -> None:
        self._campaign, self._folder, self._progress = campaign, folder, progress
        self._configs = {one.name: settings_of(one, campaign.config) for one in campaign.scenarios}
        self._plants = {plant_of(campaign.config): ""}
        for name, config in self._configs.items():
            self._plants.setdefault(plant_of(config), name)
        self._starts = {
            plant: starting_states(
                folder,
                replace(campaign.config, flow=plant[0], body=plant[1]),
                campaign.phases,
                scenario,
                partial(self._developing, scenario),
            )
            for plant, scenario in self._plants.items()
        }
        self._digests = {plant: [digest_of(state) for state in states] for plant, states in self._starts.items()}
        self._outcomes: dict[str, RunOutcome] = {}
        self._claimed = False
        self._total = self.made = self.kept = 0

    def _developing(self, scenario: str, t: float, total: float) -> None:
        self._progress(0, 0, f"the wake of {scenario or 'all'}, {t:.0f} of {total:.0f} t_c")

    def run(self, workers: int, scheduler: str | None) -> None:
        """Compute the missing runs."""
        tasks = {task.name: task for scenario in self._campaign.scenarios for task in self._tasks(scenario)}
        missing = []
        for name, task in tasks.items():
            outcome = self._folder.outcome(name, self._key(task))
            if outcome is None:
                missing.append(task)
            else:
                self._outcomes[name] = outcome
                self.kept += 1
        self._total = len(tasks)
        self._progress(len(self._outcomes), self._total, "")
        spread(
            missing,
            lambda task: (run_task, task, self._campaign.bundle, self._starts[task.plant][task.phase]),
            workers=workers,
            scheduler=scheduler,
            names=lambda task: (f"run {task.name}", "finished runs are stored"),
            finished=self._finished,
            slots=lambda threads: sum(threads.values()),
        )

    def rows(self) -> tuple[ScenarioRow, ...]:
        """Return the classified outcome of every scenario."""
        scenarios = self._campaign.scenarios
        return judged(scenarios, {one.name: self._phases(one) for one in scenarios})

    def _phases(self, scenario: Scenario) -> list[PhaseOutcomes]:
        names = [(_name(scenario.name, i), self._free_name(scenario, i)) for i in range(self._campaign.phases)]
        return [PhaseOutcomes(under=self._outcomes[under], free=self._outcomes[free]) for under, free in names]

    def _finished(self, task: RunTask, outcome: RunOutcome) -> None:
        self.claim()
        outcome = replace(outcome, key=self._key(task))
        self._folder.keep(task.name, outcome)
        self._outcomes[task.name] = outcome
        self.made += 1
        self._progress(len(self._outcomes), self._total, task.name)

    def claim(self) -> None:
        """Write the campaign's label, initial states and reused runs into the folder, before any new run is written."""
        if self._claimed:
            return
        self._folder.claim(self._campaign.label())
        for plant, scenario in self._plants.items():
            keep_states(self._folder, self._starts[plant], scenario)
        for name, outcome in self._outcomes.items():
            # A reused run may come from a campaign that is being replaced; its file was deleted with that campaign.
            self._folder.keep(name, outcome)
        self._claimed = True

    def _tasks(self, scenario: Scenario) -> list[RunTask]:
        """Return a scenario's runs under control, and the runs of the same flow without control."""
        campaign, made = self._campaign, []
        config = self._configs[scenario.name]
        of_flow = replace(campaign.config, flow=config.flow, body=config.body)
        for phase in range(campaign.phases):
            free = self._free_name(scenario, phase)
            for name, drawn, disturb, used, controlled in (
                (free, free, flow_disturbances(scenario.disturb), of_flow, False),
                (_name(scenario.name, phase), scenario.name, scenario.disturb, config, True),
            ):
                seed = seed_of(campaign.seed, drawn, phase)
                made.append(
                    RunTask(
                        name=name,
                        disturb=disturb,
                        config=used,
                        controlled=controlled,
                        phase=phase,
                        seed=seed,
                        timing=campaign.timing,
                    )
                )
        return made

    def _free_name(self, scenario: Scenario, phase: int) -> str:
        of_all = plant_of(self._campaign.config)
        changed = flow_disturbances(scenario.disturb) or plant_of(self._configs[scenario.name]) != of_all
        return _name(f"{scenario.name}.{UNCONTROLLED}" if changed else UNCONTROLLED, phase)

    def _key(self, task: RunTask) -> str:
        return task.key(self._campaign.bundle.digest, self._digests[task.plant][task.phase], version("stillwake"))


def _name(scenario: str, phase: int) -> str:
    return f"{scenario}.phase{phase}"
