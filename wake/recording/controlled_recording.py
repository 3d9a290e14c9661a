"""Recording where the controller lives: a round of episodes under it, added to a data set."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from contract.config.tree import Config
from contract.recording.appending import append, read_to_append
from contract.recording.dataset import Episode
from wake.recording.controlled_plan import ControlledRound
from wake.recording.episode_job import EpisodeJob, Progress, setting_of
from wake.recording.feedback import PolicyFactory
from wake.recording.recorder import BLOCK_STEPS, finished_jobs, jobs_for, task_of

FACTS = ("flow", "grid")
"""Provenance that all episodes of a data set must share; start, versions and forcing may differ."""


def record_round(
    output: Path,
    planned: ControlledRound,
    config: Config,
    policy: PolicyFactory,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    progress: Progress = lambda name, done, total: None,
    notice: Callable[[str], None] = lambda line: None,
    block_steps: int = BLOCK_STEPS,
    start: Path | None = None,
) -> int:
    """Record the wake under a controller and add the episodes to a data set, which is made if there is none.

    The round's number is one more than the highest in the file, so that a second call adds new data and repeats none.
    A call that was stopped is continued by the next one, at whatever instant that was: stopped between adding its
    round and clearing its parts away, it only does the latter.

    Args:
        output: the HDF5 file.
        planned: what to record.
        config: flow and forcing settings.
        policy: makes the controller in each recording process.
        workers, scheduler, progress, notice, block_steps, start: as for `wake.recording.recorder.record`.

    Returns:
        The round's number.

    Raises:
        DatasetError: if the file is no data set, or was recorded with another schema or flow; before anything is
            recorded.
        StillwakeError, PlantError: as `wake.recording.recorder.record` does, or what the controller raises.
    """
    jobs = partial(jobs_for, output, config=config, block_steps=block_steps, policy=policy, start=start)
    facts = {name: value for name, value in setting_of(config).items() if name in FACTS}
    there = read_to_append(output, facts)
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
        append(output, tuple(job.episode() for job in finished), facts)
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
