"""The recording of a data set. Episodes are recorded in turn or in parallel, then written. A round adds episodes."""

import json
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.config.body import layout_of
from contract.config.tree import Config
from contract.errors import DatasetError, OutputError, StillwakeError
from contract.recording.dataset import Dataset, Episode, append, read, read_to_append, write
from contract.side_by_side import spread
from contract.typed import differences
from wake.recording import episode_job
from wake.recording.episode_job import EpisodeJob, EpisodeProgress, NoFeedback, PartsFolder, PolicyFactory, setting_of
from wake.recording.plans import CalmRound, ControlledRound, EpisodePlan, Plan
from wake.truck.truck_wake import TruckWake

_WAYS: Final = "give --overwrite to replace it, or another name"


def _difference(there: Sequence[Episode], jobs: Sequence[EpisodeJob]) -> str | None:
    """Return the first difference of a file's episodes from those of the jobs; episodes of rounds are not compared."""
    by_name = {episode.name: episode for episode in there}
    for job in jobs:
        plan, episode = job.plan, by_name.pop(job.plan.name, None)
        if episode is None:
            return f"it has no episode {plan.name}, but {', '.join(item.name for item in there)}"
        if len(episode) != plan.steps:
            return f"episode {plan.name} has {len(episode)} steps, not {plan.steps}"
        made, wanted = dict(episode.provenance), json.loads(json.dumps(job.provenance))
        made.pop("versions", None)  # a recording is valid with any versions of the software
        if made.get("start_sha256") == wanted.get("start_sha256"):
            made.pop("start", None)  # the name of the file with this state
        for name, before, now in differences(made, wanted):
            # Entries that only one version of the software stores are not compared.
            if before is not None and now is not None:
                return f"episode {plan.name} has {name} = {before}, not {now}"
    others = [name for name, episode in by_name.items() if "round" not in episode.provenance]
    return f"it also has episode {others[0]}" if others else None


BLOCK_STEPS: Final = 100


def record(
    output: Path,
    plans: Sequence[EpisodePlan],
    config: Config,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    progress: EpisodeProgress = lambda name, done, total: None,
    notice: Callable[[str], None] = lambda line: None,
    block_steps: int = BLOCK_STEPS,
    start: Path | None = None,
    overwrite: bool = False,
) -> bool:
    """Record the episodes of all plans and write the data set.

    Unfinished work is stored in `<output>.parts`; the next call with equal plans and settings continues this work. A
    data set that exists with equal plans and settings remains unchanged. Returns whether a file was written.

    Args:
        plans: episodes, in their order in the file.
        workers: number of processes on this machine; with 1, episodes are recorded one after another in this process.
        scheduler: address of a dask scheduler whose workers record instead. The folder of `output` must have the same
            path on every worker.
        progress: called once for every episode at the beginning, and then after each block of an episode.
        notice: called with a line of text when a worker was lost or has joined.
        block_steps: number of control steps between two writes to disk.
        start: file of the flow state in which episodes begin; None means the shipped state. Workers read this path.
        overwrite: whether an existing file is replaced as soon as the new file is complete.

    Raises OutputError if `output` exists with other plans or settings, and `overwrite` is False; StillwakeError if the
    output cannot be written, stored parts have other plans or settings, or workers fail; PlantError if the flow
    diverges, or cannot start in `start`.
    """
    wanted = jobs_for(output, plans, config, block_steps=block_steps, start=start)
    if output.exists() and not overwrite:
        try:
            there = read(output).episodes
        except DatasetError as error:
            raise OutputError(f"{output}: exists, but cannot be read ({error}); {_WAYS}") from error
        if difference := _difference(there, wanted):
            raise OutputError(f"{output}: holds another recording ({difference}); {_WAYS}")
        # An earlier call may have been killed after it wrote the file and before it removed its parts.
        if wanted[0].parts.task() == task_of(wanted):
            wanted[0].parts.clear()
        return False
    with finished_jobs(wanted, workers=workers, scheduler=scheduler, progress=progress, notice=notice) as jobs:
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
    """Return the jobs of one call; nothing is written yet. Raises PlantError if a plant cannot start in `start`."""
    start = None if start is None else start.absolute()
    episode_job.check_start(config, start)
    shared: dict[str, Any] = {"config": config, "block_steps": block_steps, "policy": policy, "start": start}
    shared |= {"parts": PartsFolder.for_output(output), "owner": uuid.uuid4().hex}
    shared["setting"] = setting_of(config, plans[0].packages, start)
    return tuple(EpisodeJob(plan=plan, **shared) for plan in plans)


def task_of(jobs: Sequence[EpisodeJob]) -> dict[str, Any]:
    """Return the settings that distinguish the parts of this recording from the parts of others, as plain JSON."""
    return {"plans": [asdict(job.plan) for job in jobs], "block_steps": jobs[0].block_steps, **jobs[0].setting}


Notice = Callable[[str], None]
"""A function that is called with a line of text."""


@contextmanager
def finished_jobs(
    jobs: Sequence[EpisodeJob], *, workers: int, scheduler: str | None, progress: EpisodeProgress, notice: Notice
) -> Iterator[Sequence[EpisodeJob]]:
    """Record the missing blocks of a call's jobs, and yield the jobs. The `with` block stores the jobs' episodes. If it
    raises no error, the parts of the jobs are then removed. Arguments and errors are as for `record`."""
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
            run_parallel(unfinished, workers=workers, scheduler=scheduler, progress=progress, notice=notice)
    finally:
        parts.disown(jobs[0].owner)
        for folder in missing:
            with suppress(OSError):  # a folder that is not empty remains
                folder.rmdir()
    yield jobs
    parts.clear()


def run_parallel(
    jobs: Sequence[EpisodeJob], *, workers: int, scheduler: str | None, progress: EpisodeProgress, notice: Notice
) -> None:
    """Record the jobs' episodes on workers, the episode with the most missing steps first. An episode whose worker dies
    continues from its last block. `progress` is called for each episode whose number of recorded steps has changed
    since the last poll; `contract.side_by_side.spread` explains the other arguments and errors."""
    done = {job.plan.name: job.blocks.finished for job in jobs}
    present: set[str] = set()

    def look(threads: Mapping[str, int]) -> None:
        for job in jobs:
            finished = job.blocks.finished
            if finished != done[job.plan.name]:
                done[job.plan.name] = finished
                progress(job.plan.name, finished, job.plan.steps)
        for address in sorted(present - threads.keys()):
            notice(f"worker {address} was lost; its episode continues from its last block")
        for address in sorted(threads.keys() - present if present else ()):
            notice(f"worker {address} joined")
        present.clear()
        present.update(threads)

    def check_arrived(job: EpisodeJob) -> None:
        if job.blocks.finished < job.plan.steps:
            raise StillwakeError(f"episode {job.plan.name}: its worker's blocks are missing in {job.blocks.folder}")

    spread(
        sorted(jobs, key=lambda job: job.blocks.finished - job.plan.steps),
        lambda job: (job.run,),
        workers=workers,
        scheduler=scheduler,
        names=lambda job: (f"episode {job.plan.name}", f"finished blocks are stored in {job.parts.path}"),
        finished=lambda job, _: check_arrived(job),
        looked=look,
    )
    look(dict.fromkeys(present, 1))


_FACTS = ("flow", "grid")
"""Provenance entries that are equal for all episodes of a data set; start, versions and forcing may differ."""


def record_round(
    output: Path,
    planned: ControlledRound | CalmRound,
    config: Config,
    policy: PolicyFactory = NoFeedback,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    progress: EpisodeProgress = lambda name, done, total: None,
    notice: Callable[[str], None] = lambda line: None,
    block_steps: int = BLOCK_STEPS,
    start: Path | None = None,
) -> int:
    """Record a round, and add its episodes to a data set, which is created if it does not exist. Returns the round's
    number: one more than the highest number in the file.

    If a call was interrupted, the next call continues its work, or only removes the parts if the round was already
    added. Raises DatasetError before recording if the file is not a data set, or was recorded with another schema or
    flow; StillwakeError and PlantError as `record` does, or the controller's error. `policy` builds the controller in
    each recording process; without it, only the plans' signals act. The other parameters are as for `record`.
    """
    jobs = partial(jobs_for, output, config=config, block_steps=block_steps, policy=policy, start=start)
    facts = {name: value for name, value in setting_of(config).items() if name in _FACTS}
    layout = layout_of(config.body)
    there = read_to_append(output, facts, layout).episodes
    number = max((int(episode.provenance.get("round", 0)) for episode in there), default=0) + 1
    before = jobs(planned.plans(number - 1))
    if _added(before, there):
        before[0].parts.clear()
        return number - 1
    wanted = jobs(planned.plans(number))
    with finished_jobs(wanted, workers=workers, scheduler=scheduler, progress=progress, notice=notice) as finished:
        append(output, tuple(job.episode() for job in finished), facts, layout)
    return number


def _added(jobs: Sequence[EpisodeJob], there: Sequence[Episode]) -> bool:
    """Return whether the data set already holds the jobs' episodes while their parts still exist."""
    if jobs[0].parts.task() != task_of(jobs) or any(job.blocks.finished < job.plan.steps for job in jobs):
        return False
    by_name = {episode.name: episode for episode in there}
    # Actions are stored in full precision and differ between recordings, so the actions identify an episode.
    return all(
        job.plan.name in by_name
        and np.array_equal(by_name[job.plan.name].series["action"], job.blocks.series()["action"])
        for job in jobs
    )
