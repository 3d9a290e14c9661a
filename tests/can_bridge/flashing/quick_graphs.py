"""Judge a graph of the same bytes once in a process: that takes most of a boot, and says nothing about the memory.

Signature and hashes are computed anew at every boot, from the bytes that the memory gave back.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Final

from contract.release import bundle

_JUDGES: Final = ("check_graph", "check_estimator_graph")
_GRAPHS: Final = 16
"""Of each kind that are remembered."""


@contextmanager
def graphs_judged_once() -> Iterator[None]:
    """Within it."""
    before = {name: getattr(bundle, name) for name in _JUDGES}
    try:
        for name, judge in before.items():
            setattr(bundle, name, lru_cache(_GRAPHS)(judge))
        yield
    finally:
        for name, judge in before.items():
            setattr(bundle, name, judge)
