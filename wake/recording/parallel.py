"""Parallel recording of episodes: workers record, and this process watches the folder that they share."""

from collections.abc import Callable, Mapping, Sequence

from contract.errors import StillwakeError
from contract.side_by_side import spread
from wake.recording.episode_job import EpisodeJob, EpisodeProgress


def run_parallel(
    jobs: Sequence[EpisodeJob],
    *,
    workers: int,
    scheduler: str | None,
    progress: EpisodeProgress,
    notice: Callable[[str], None],
) -> None:
    """Record the jobs' episodes, one per worker at a time, the episode with the most missing steps first. An episode
    whose worker dies continues from its last block. `contract.side_by_side.spread` explains the other arguments and
    errors.

    Args:
        progress: called for each episode whose number of recorded steps has changed since the last poll.
        notice: called with a line of text when a worker was lost or has joined.
    """
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

    spread(
        sorted(jobs, key=lambda job: job.blocks.finished - job.plan.steps),
        lambda job: (job.run,),
        workers=workers,
        scheduler=scheduler,
        names=lambda job: (f"episode {job.plan.name}", f"finished blocks are stored in {job.parts.path}"),
        finished=lambda job, _: _check_arrived(job),
        looked=look,
    )
    look(dict.fromkeys(present, 1))


def _check_arrived(job: EpisodeJob) -> None:
    if job.blocks.finished < job.plan.steps:
        raise StillwakeError(f"episode {job.plan.name}: its worker's blocks do not arrive in {job.blocks.folder}")
