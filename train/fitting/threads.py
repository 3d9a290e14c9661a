"""How many threads torch may use, and whether they compute with denormal numbers.

One by default: with other work on the machine, OpenMP's threads spin while they wait for each other, and a step was
measured to cost ten times its CPU time with two threads. More threads change the order of sums, and so a model's bytes.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from contract.errors import ConfigError


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Torch computes with so many threads inside the block; the caller's number is restored after it. Raises
    ConfigError for a number below 1."""
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
    """Numbers too small for a full mantissa are zero inside the block, in this thread.

    A flow of single precision and its adjoint have many, where a wave dies out. Some processors take a hundred times as
    long for each: a gradient took three times as long (by hand, Xeon of 2.5 GHz).
    """
    # Torch does not tell what was set; nothing else in this program sets it.
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
