"""Recording a data set: episodes one after the other or side by side, then one HDF5 file."""

import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from contract.config.body_sensors import layout_of
from contract.config.tree import Config
from contract.recording.dataset import Dataset, write
from wake.recording.episode_job import EpisodeJob, Progress, check_start, setting_of
from wake.recording.episode_plan import EpisodePlan
from wake.recording.feedback import NoFeedback, PolicyFactory
from wake.recording.finished import is_finished
from wake.recording.parts_folder import PartsFolder
from wake.recording.plan import Plan
from wake.truck.truck_wake import TruckWake

BLOCK_STEPS: Final = 100


def record(
    output: Path,
    plans: Sequence[EpisodePlan],
    config: Config,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    progress: Progress = lambda name, done, total: None,
    notice: Callable[[str], None] = lambda line: None,
    block_steps: int = BLOCK_STEPS,
    start: Path | None = None,
    overwrite: bool = False,
) -> bool:
    """Record every plan from the start and write the data set.

    Unfinished work is kept in `<output>.parts` and continued by the next call with the same plans and settings. A data
    set that is there already, of the same plans and settings, is left as it is. Returns whether anything was written;
    False if the data set was there already.

    Args:
        plans: episodes, in the order they will have in the file.
        workers: processes on this machine; with 1, episodes follow one another in this process.
        scheduler: address of a dask scheduler whose workers record instead; they must have `output`'s folder under
            the same path.
        progress: called for every episode at the start, and then after its blocks.
        notice: called with a line when a worker was lost or joined.
        block_steps: control steps between two writes to disk.
        start: file of the flow state in which episodes begin; the shipped one if None. Workers read it at its path.
        overwrite: replace a file that is there, when the new one is whole.

    Raises:
        OutputError: if there is a file of other plans or settings, and it is not to be replaced.
        StillwakeError: if the output cannot be written, the parts there belong to other plans or settings, or workers
            fail.
        PlantError: if the flow diverges.
    """
    wanted = jobs_for(output, plans, config, block_steps=block_steps, start=start)
    if not overwrite and is_finished(output, wanted):
        if wanted[0].parts.task() == task_of(wanted):
            # Left by a call that was killed between writing the file and clearing up.
            wanted[0].parts.clear()
        return False
    with finished_jobs(
        wanted,
        workers=workers,
        scheduler=scheduler,
        progress=progress,
        notice=notice,
    ) as jobs:
        write(output, Dataset(episodes=tuple(job.episode() for job in jobs), layout=layout_of(config.body)))
    return True


def jobs_for(
    output: Path,
    plans: Sequence[Plan],
    config: Config,
    *,
    block_steps: int,
    policy: PolicyFactory = NoFeedback,
    start: Path | None = None,
) -> tuple[EpisodeJob, ...]:
    """The work of one call; nothing is written yet. Raises PlantError if it cannot begin in the start."""
    start = None if start is None else start.absolute()
    check_start(config, start)
    parts, owner, setting = (
        PartsFolder.for_output(output),
        uuid.uuid4().hex,
        setting_of(config, plans[0].packages, start),
    )
    return tuple(
        EpisodeJob(
            parts=parts,
            owner=owner,
            plan=plan,
            config=config,
            block_steps=block_steps,
            setting=setting,
            policy=policy,
            start=start,
        )
        for plan in plans
    )


def task_of(jobs: Sequence[EpisodeJob]) -> dict[str, Any]:
    """By what one recording's parts differ from another's, as plain JSON."""
    return {"plans": [asdict(job.plan) for job in jobs], "block_steps": jobs[0].block_steps, **jobs[0].setting}


@contextmanager
def finished_jobs(
    jobs: Sequence[EpisodeJob],
    *,
    workers: int,
    scheduler: str | None,
    progress: Progress,
    notice: Callable[[str], None],
) -> Iterator[Sequence[EpisodeJob]]:
    """Record what is missing of jobs from one call, yield them to be kept, and clear their parts away if they were.

    Arguments and errors are those of `record`.
    """
    parts, config = jobs[0].parts, jobs[0].config
    missing = [folder for folder in parts.path.parents if not folder.exists()]
    parts.claim(task_of(jobs), jobs[0].owner)
    try:
        for job in jobs:
            progress(job.plan.name, job.blocks.finished, job.plan.steps)
        unfinished = [job for job in jobs if job.blocks.finished < job.plan.steps]
        if scheduler is None and min(workers, len(unfinished)) <= 1:
            wake = TruckWake(config.flow, body=config.body) if unfinished else None
            for job in unfinished:
                job.run(wake, progress)
        else:
            # Needed only here: one process records without dask.
            from wake.recording.parallel import run_parallel

            run_parallel(unfinished, workers=workers, scheduler=scheduler, progress=progress, notice=notice)
    finally:
        parts.disown(jobs[0].owner)
        for folder in missing:
            # Stays unless it is empty.
            with suppress(OSError):
                folder.rmdir()
    yield jobs
    parts.clear()
