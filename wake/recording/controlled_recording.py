"""Recording where the controller lives, or where it shall lead: a round of episodes, added to a data set."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from contract.config.body_sensors import layout_of
from contract.config.tree import Config
from contract.recording.appending import append, read_to_append
from contract.recording.dataset import Episode
from wake.recording.episode_job import EpisodeJob, Progress, setting_of
from wake.recording.feedback import NoFeedback, PolicyFactory
from wake.recording.plan import Plan
from wake.recording.recorder import BLOCK_STEPS, finished_jobs, jobs_for, task_of

FACTS = ("flow", "grid")
"""Provenance that all episodes of a data set must share; start, versions and forcing may differ."""


class Round(Protocol):
    """Episodes that are added together, such as `ControlledRound` and `CalmRound`."""

    def plans(self, number: int) -> Sequence[Plan]:
        """The episodes of round `number`; their provenance holds it as "round"."""


def record_round(
    output: Path,
    planned: Round,
    config: Config,
    policy: PolicyFactory = NoFeedback,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    progress: Progress = lambda name, done, total: None,
    notice: Callable[[str], None] = lambda line: None,
    block_steps: int = BLOCK_STEPS,
    start: Path | None = None,
) -> int:
    """Record a round and add its episodes to a data set, which is made if there is none.

    The round's number is one more than the highest in the file, so that a second call adds new data and repeats none. A
    call that was stopped is continued by the next one, at whatever instant that was: stopped between adding its round
    and clearing its parts away, it only does the latter. Raises DatasetError if the file is no data set, or was
    recorded with another schema or flow; before anything is recorded; StillwakeError, PlantError as
    `wake.recording.recorder.record` does, or what the controller raises. Returns the round's number.

    Args:
        policy: makes the controller in each recording process; without one, the plans' signals are all that acts.
        workers, scheduler, progress, notice, block_steps, start: as for `wake.recording.recorder.record`.
    """
    jobs = partial(jobs_for, output, config=config, block_steps=block_steps, policy=policy, start=start)
    facts = {name: value for name, value in setting_of(config).items() if name in FACTS}
    layout = layout_of(config.body)
    there = read_to_append(output, facts, layout)
    number = max((int(episode.provenance.get("round", 0)) for episode in there), default=0) + 1
    before = jobs(planned.plans(number - 1))
    if _added(before, there):
        before[0].parts.clear()
        return number - 1
    with finished_jobs(
        jobs(planned.plans(number)),
        workers=workers,
        scheduler=scheduler,
        progress=progress,
        notice=notice,
    ) as finished:
        append(output, tuple(job.episode() for job in finished), facts, layout)
    return number


def _added(jobs: Sequence[EpisodeJob], there: Sequence[Episode]) -> bool:
    """Whether parts of these jobs are left over although their episodes are in the data set."""
    if jobs[0].parts.task() != task_of(jobs) or any(job.blocks.finished < job.plan.steps for job in jobs):
        return False
    by_name = {episode.name: episode for episode in there}
    # Actions are stored in full, and no two recordings have the same.
    return all(
        job.plan.name in by_name
        and np.array_equal(by_name[job.plan.name].series["action"], job.blocks.series()["action"])
        for job in jobs
    )
