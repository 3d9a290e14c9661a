"""The functions that run work in parallel processes: on this machine, or in dask workers, which may be on other
machines and may die. No process and no temporary file remains, even if the work fails or is stopped."""

import logging
import multiprocessing
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING, Any, Final, TypeVar

from contract.errors import StillwakeError

if TYPE_CHECKING:
    from distributed import Client, Future, LocalCluster

J = TypeVar("J")
_STOPS: Final = (signal.SIGINT, signal.SIGTERM)
"""Signals that stop a command. Child processes ignore these signals, so that only the parent process reacts."""
_POLL_S: Final = 0.2
_CONNECT_S: Final = 10.0


@contextmanager
def process_pool(workers: int, initializer: Callable[[], None] | None = None) -> Iterator[ProcessPoolExecutor]:
    """Open a pool of new processes, each of which first calls `initializer`. An error or a stop signal kills them."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory(prefix="stillwake-", ignore_cleanup_errors=True) as scratch:
        pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin, initargs=(scratch, initializer))
        before = multiprocessing.active_children()
        try:
            yield pool
            pool.shutdown()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                if child not in before:
                    child.kill()
                    child.join()
            raise


def spread(
    jobs: Sequence[J],
    call: Callable[[J], tuple[Any, ...]],
    *,
    workers: int,
    scheduler: str | None,
    names: Callable[[J], tuple[str, str]],
    finished: Callable[[J, Any], None],
    looked: Callable[[Mapping[str, int]], None] = lambda threads: None,
    slots: Callable[[Mapping[str, int]], int] = len,
) -> None:
    """Run jobs on dask workers in the given order, each in a free slot; a local worker that dies is replaced.

    Args:
        call: returns the function and the arguments that are sent to a worker for a job; called when a slot is free.
        workers: largest number of local processes to start; there are never more processes than jobs.
        scheduler: address of a running scheduler to use instead of local processes.
        names: returns two texts for error messages: the job's name, and a note on the results that remain stored.
        finished: called in this process with every finished job and its result, in the order in which the jobs finish.
        looked: called at every poll with the number of threads of each worker, by the worker's address.
        slots: returns the number of jobs that the workers run at the same time; it gets the argument of `looked`.

    Raises StillwakeError if the scheduler cannot be reached or has no worker, if workers died too often during one job,
    or if a job raised a StillwakeError.
    """
    if not jobs:
        return
    waiting = list(reversed(jobs))
    running: dict[Future, J] = {}
    with dask_client(min(workers, len(jobs)), scheduler) as client:
        while waiting or running:
            # A job's arguments may take megabytes, so a job is sent only when a slot is free.
            threads: Mapping[str, int] = client.nthreads()
            looked(threads)
            while waiting and len(running) < max(1, slots(threads)):
                job = waiting.pop()
                running[client.submit(*call(job), pure=False)] = job
            time.sleep(_POLL_S)
            for future in [future for future in running if future.done()]:
                job = running.pop(future)
                finished(job, _result(future, *names(job)))


def _begin(scratch: str, initializer: Callable[[], None] | None) -> None:
    for number in _STOPS:
        signal.signal(number, signal.SIG_IGN)
    tempfile.tempdir = scratch
    if initializer is not None:
        initializer()


def _result(future: "Future", name: str, kept: str) -> Any:
    # dask is imported only when needed, because a vehicle does not install it.
    from distributed import KilledWorker

    if future.status == "finished":
        return future.result()
    error: BaseException | None = future.exception() if future.status == "error" else None
    if isinstance(error, StillwakeError):
        raise error
    if isinstance(error, KilledWorker):
        died = f"{error.allowed_failures + 1} workers died during this job, killed or out of memory"
        raise StillwakeError(f"{name}: {died}; {kept}") from error
    raise StillwakeError(f"{name}: its worker lost this job ({error or future.status}); {kept}") from error


@contextmanager
def dask_client(workers: int, scheduler: str | None) -> "Iterator[Client]":
    """Connect to the scheduler, or start a local cluster of single-threaded processes. Raises as `spread` does."""
    import dask.config
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    if scheduler is None:
        # The cluster has its own temporary folder, which is removed at the end, because dask leaves files there.
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


def _local_cluster(workers: int) -> "LocalCluster":
    from distributed import LocalCluster

    # The cluster's thread and all workers that it starts inherit the blocked signals. In this process the signals are
    # only delayed until the cluster has started. The start of Python's resource tracker would unblock the signals, so
    # the tracker is started first.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOPS)
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
