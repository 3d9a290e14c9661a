"""Processes that work for a measurement: none is left behind, nor what they wrote, however the measurement ends."""

import multiprocessing
import signal
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager


@contextmanager
def process_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of so many fresh processes; an error or a stop ends them in the middle of their work."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory(prefix="stillwake-", ignore_cleanup_errors=True) as scratch:
        pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin, initargs=(scratch,))
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


def _begin(scratch: str) -> None:
    # Ctrl-C and SIGTERM often reach a whole group; only the parent decides what they mean, and it ends this process.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    tempfile.tempdir = scratch
