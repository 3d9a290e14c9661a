"""Recording a data set: episodes one after the other or side by side, then one HDF5 file."""

import json
import shutil
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from contract.atomic import replacing
from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.recording.dataset import Dataset, write
from wake.recording.episode_job import EpisodeJob, Plan, Progress, differing, owner_file, setting_of
from wake.recording.episode_plan import EpisodePlan
from wake.recording.feedback import NoFeedback, PolicyFactory
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
) -> None:
    """Record every plan from the developed start and write the data set.

    Unfinished work is kept in `<output>.parts` and continued by the next call with the same plans and settings.

    Args:
        output: the HDF5 file.
        plans: episodes, in the order they will have in the file.
        config: flow and forcing settings.
        workers: processes on this machine; with 1, episodes follow one another in this process.
        scheduler: address of a dask scheduler whose workers record instead; they must see `output`'s folder under
            the same path.
        progress: called for every episode at the start, and then after its blocks.
        notice: called with a line when a worker was lost or joined.
        block_steps: control steps between two writes to disk.

    Raises:
        StillwakeError: if the output cannot be written, the parts there belong to other plans or settings, or workers
            fail.
        PlantError: if the flow diverges.
    """
    with finished_jobs(
        jobs_for(output, plans, config, block_steps=block_steps),
        workers=workers,
        scheduler=scheduler,
        progress=progress,
        notice=notice,
    ) as jobs:
        write(output, Dataset(episodes=tuple(job.episode() for job in jobs)))


def jobs_for(
    output: Path, plans: Sequence[Plan], config: Config, *, block_steps: int, policy: PolicyFactory = NoFeedback
) -> tuple[EpisodeJob, ...]:
    """The work of one call; nothing is written yet."""
    # Workers may stand in another folder.
    output = output.absolute()
    parts, owner, setting = (
        output.with_name(output.name + ".parts"),
        uuid.uuid4().hex,
        setting_of(config, plans[0].packages),
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
        )
        for plan in plans
    )


def task_of(jobs: Sequence[EpisodeJob]) -> dict[str, Any]:
    """What tells one recording's parts from another's, as plain JSON."""
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
    _claim(parts, task_of(jobs))
    with replacing(owner_file(parts)) as temporary:
        temporary.write_text(jobs[0].owner)
    for job in jobs:
        progress(job.plan.name, job.blocks.finished, job.plan.steps)
    unfinished = [job for job in jobs if job.blocks.finished < job.plan.steps]
    try:
        if scheduler is None and min(workers, len(unfinished)) <= 1:
            wake = TruckWake(config.flow) if unfinished else None
            for job in unfinished:
                job.run(wake, progress)
        else:
            # Needed only here: one process records without dask.
            from wake.recording.parallel import run_parallel

            run_parallel(unfinished, workers=workers, scheduler=scheduler, progress=progress, notice=notice)
    finally:
        owner_file(parts).unlink(missing_ok=True)
    yield jobs
    clear(parts)


def label_file(parts: Path) -> Path:
    """Where the task stands that parts belong to."""
    return parts / "task.json"


def clear(parts: Path) -> None:
    """Remove parts that are no longer needed; whoever is killed meanwhile leaves all of them or none."""
    gone = _gone(parts)
    shutil.rmtree(gone, ignore_errors=True)
    parts.replace(gone)
    shutil.rmtree(gone)


def _gone(parts: Path) -> Path:
    return parts.with_name(parts.name + ".done")


def _claim(parts: Path, task: Mapping[str, Any]) -> None:
    """Make the folder of parts ours, or make sure it already is."""
    shutil.rmtree(_gone(parts), ignore_errors=True)
    label = label_file(parts)
    if parts.is_dir() and any(path.is_dir() for path in parts.iterdir()):
        try:
            found = json.loads(label.read_text())
        except (OSError, ValueError):
            raise StillwakeError(f"{parts} holds parts of an unknown recording: delete it first") from None
        if found != task:
            raise StillwakeError(
                f"{parts} holds an unfinished recording with other settings ({differing(found, task)}): finish it "
                f"with those, or delete it first"
            )
        return
    # Nothing is recorded yet, whatever an earlier call had in mind.
    with replacing(label) as temporary:
        temporary.write_text(json.dumps(task, sort_keys=True))
