"""Episodes side by side: dask workers record, this process hands out the work and watches the folder they share."""

import logging
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Final

import dask.config
from distributed import Client, Future, KilledWorker, LocalCluster

from contract.errors import StillwakeError
from wake.recording.episode_job import EpisodeJob, Progress

_POLL_S: Final = 0.5
_CONNECT_S: Final = 10.0


def run_parallel(
    jobs: Sequence[EpisodeJob],
    *,
    workers: int,
    scheduler: str | None,
    progress: Progress,
    notice: Callable[[str], None],
) -> None:
    """Record the jobs, the longest first, one to a worker at a time.

    A local worker that dies is replaced, and its episode continues from its last block. Raises StillwakeError if the
    scheduler cannot be reached or has no worker, a worker died too often over one episode, or what recording the
    episode raised there.

    Args:
        workers: local processes to start; at most one a job.
        scheduler: address of a running scheduler to use instead.
        progress: called for every episode that has got further.
        notice: called with a line when a worker was lost or joined.
    """
    waiting = sorted(jobs, key=lambda job: job.plan.steps - job.blocks.finished)
    running: dict[Future, EpisodeJob] = {}
    done = {job.plan.name: job.blocks.finished for job in jobs}
    with dask_client(min(workers, len(jobs)), scheduler) as client:
        present = set(client.nthreads())
        while waiting or running:
            while waiting and len(running) < max(1, len(present)):
                job = waiting.pop()
                running[client.submit(job.run, key=f"{job.plan.name}-{job.owner}", pure=False)] = job
            time.sleep(_POLL_S)
            for future in [future for future in running if future.done()]:
                _finish(future, running.pop(future))
            for job in jobs:
                finished = job.blocks.finished
                if finished != done[job.plan.name]:
                    done[job.plan.name] = finished
                    progress(job.plan.name, finished, job.plan.steps)
            before, present = present, set(client.nthreads())
            for address in sorted(before - present):
                notice(f"worker {address} was lost; its episode continues from its last block")
            for address in sorted(present - before):
                notice(f"worker {address} joined")


def _finish(future: Future, job: EpisodeJob) -> None:
    if future.status == "finished":
        if job.blocks.finished < job.plan.steps:
            raise StillwakeError(f"episode {job.plan.name}: its worker's blocks do not arrive in {job.blocks.folder}")
        return
    error: BaseException | None = future.exception() if future.status == "error" else None
    if isinstance(error, StillwakeError):
        raise error
    if isinstance(error, KilledWorker):
        raise StillwakeError(
            f"episode {job.plan.name}: {error.allowed_failures + 1} workers died over it, killed or out of "
            f"memory; finished blocks are kept in {job.parts.path}"
        )
    raise StillwakeError(f"episode {job.plan.name}: lost by its worker ({error or future.status})") from error


@contextmanager
def dask_client(workers: int, scheduler: str | None) -> Iterator[Client]:
    """A client of the scheduler, or of a new local cluster of single-threaded processes."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    if scheduler is None:
        # Of its own: what dask writes into the shared temporary folder, it leaves there.
        with (
            tempfile.TemporaryDirectory(prefix="stillwake-", ignore_cleanup_errors=True) as scratch,
            dask.config.set({"temporary-directory": scratch}),
            _local_cluster(workers) as cluster,
            Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = Client(scheduler, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise StillwakeError(f"cannot reach scheduler {scheduler}: {error}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_CONNECT_S)
        except TimeoutError as error:
            raise StillwakeError(f"scheduler {scheduler} has no worker") from error
        yield client


def _local_cluster(workers: int) -> LocalCluster:
    # Ctrl-C reaches every process of a terminal, SIGTERM often those of a whole service, and only this one shall decide
    # what they mean. The cluster's thread and the workers it starts, now or later, inherit the blocked signals; here
    # they are only put off until they stand. Python's resource tracker would unblock them again if it were started
    # meanwhile.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=0,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
