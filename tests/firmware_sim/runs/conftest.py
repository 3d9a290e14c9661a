"""A short run of numbers."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from firmware_sim.runs.run_log import COLUMNS, BusTotals, RunLog


@pytest.fixture
def log_of(run_metadata) -> Callable[..., RunLog]:
    """A run of six periods of 0.2 t_c; columns not given are zero."""

    def make(enabled_at: int = 2, settle: float = 0.4, **columns) -> RunLog:
        series = {name: np.zeros(6) for name in COLUMNS}
        series["t"] = 100.0 + 0.2 * np.arange(6, dtype=np.float64)
        series |= {name: np.array(values, dtype=float) for name, values in columns.items()}
        bus = BusTotals(sent=12, lost=1, rejected=2)
        return RunLog(series=series, enabled_at=enabled_at, bus=bus, metadata=replace(run_metadata, settle=settle))

    return make
