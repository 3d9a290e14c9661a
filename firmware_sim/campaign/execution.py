"""Runs side by side: dask workers compute them, this process hands them out and keeps what is finished."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from distributed import Client, Future, KilledWorker

from contract.errors import StillwakeError
from contract.release.checks import Bundle
from firmware_sim.campaign.outcome import Outcome
from firmware_sim.campaign.running import run_task
from firmware_sim.campaign.task import PlantKey, Task
from wake.recording.parallel import dask_client
from wake.truck.state import State

_POLL_S: Final = 0.2


def execute(
    tasks: Sequence[Task],
    bundle: Bundle,
    starts: Mapping[PlantKey, Sequence[State]],
    *,
    workers: int,
    scheduler: str | None,
    finished: Callable[[Task, Outcome], None],
) -> None:
    """Compute the tasks, one to a worker's thread at a time. Raises StillwakeError if the scheduler cannot be reached
    or has no worker, or a worker died too often over one run.

    Args:
        tasks: what is to be run; an outcome depends on its task alone, not on the worker or on what ran before.
        starts: flow states of each plant by phase.
        workers: local processes to start; at most one a task.
        scheduler: address of a running scheduler to use instead.
        finished: called in this process with every task that is done, in the order they finish.
    """
    if not tasks:
        return
    waiting = list(reversed(tasks))
    running: dict[Future, Task] = {}
    with dask_client(min(workers, len(tasks)), scheduler) as client:
        while waiting or running:
            # A release and a state are megabytes: no more of them under way than are being worked on.
            while waiting and len(running) < _slots(client):
                task = waiting.pop()
                running[client.submit(run_task, task, bundle, starts[task.plant][task.phase], pure=False)] = task
            time.sleep(_POLL_S)
            for future in [future for future in running if future.done()]:
                task = running.pop(future)
                finished(task, _outcome(task, future))


def _slots(client: Client) -> int:
    threads: dict[str, int] = client.nthreads()
    return max(1, sum(threads.values()))


def _outcome(task: Task, future: Future) -> Outcome:
    if future.status == "finished":
        outcome: Outcome = future.result()
        return outcome
    error: BaseException | None = future.exception() if future.status == "error" else None
    if isinstance(error, KilledWorker):
        raise StillwakeError(
            f"run {task.name}: {error.allowed_failures + 1} workers died over it, killed or out of memory; finished "
            "runs are kept"
        )
    raise StillwakeError(f"run {task.name}: lost by its worker ({error or future.status}); finished runs are kept")
