"""A recording killed at any change it makes on disk."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract.recording.dataset import Dataset


class Killed(BaseException):
    """Stands for a signal: not an Exception, so nothing may swallow it."""


def kill_before_operation(monkeypatch: pytest.MonkeyPatch, number: int) -> Callable[[], int]:
    """Be killed before the operation of that number that changes the disk; how many there have been."""
    count = 0

    def watched(original: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            nonlocal count
            count += 1
            if count == number:
                raise Killed
            return original(*arguments, **options)

        return call

    for owner, name in ((Path, "replace"), (Path, "unlink"), (Path, "mkdir"), (os, "fsync"), (Path, "write_bytes")):
        monkeypatch.setattr(owner, name, watched(getattr(owner, name)))
    return lambda: count


def equal(a: Dataset, b: Dataset) -> bool:
    """Whether two recordings have the same episodes and samples."""
    return [x.name for x in a.episodes] == [y.name for y in b.episodes] and all(
        np.array_equal(x.series[name], y.series[name])
        for x, y in zip(a.episodes, b.episodes, strict=True)
        for name in x.series
    )
