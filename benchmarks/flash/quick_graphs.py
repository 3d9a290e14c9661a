"""Judge a graph of the same bytes once in a process: that takes most of a boot, and says nothing about the memory.

Signature and hashes are computed anew at every boot, from the bytes that the memory gave back.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

from contract.release import bundle


@contextmanager
def graphs_judged_once() -> Iterator[None]:
    """Within it."""
    before = bundle.check_graph, bundle.check_estimator_graph
    bundle.check_graph, bundle.check_estimator_graph = map(lru_cache(maxsize=16), before)
    try:
        yield
    finally:
        bundle.check_graph, bundle.check_estimator_graph = before
