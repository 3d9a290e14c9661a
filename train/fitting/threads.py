"""The settings of torch for the number of threads and for denormal numbers.

The default is one thread. On a machine with other work, a step with two threads used ten times the CPU time of one
thread (measured). The number of threads changes the order of sums, and so the bytes of a trained model.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from contract.errors import ConfigError


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Set torch's number of threads inside the block, then restore it; raises ConfigError for a number below 1."""
    if count < 1:
        raise ConfigError(f"threads = {count}: must be at least 1")
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def without_denormals() -> Iterator[None]:
    """Flush denormal numbers to zero inside the block, in this thread. Where a wave decays, a flow in single precision
    and its adjoint have many denormal numbers. Some processors take a hundred times as long for such numbers; a
    gradient took three times as long (measured once, Xeon of 2.5 GHz)."""
    # Torch cannot report the previous setting. Nothing else switches this setting on, so it is switched off after the
    # block.
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
