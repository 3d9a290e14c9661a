"""Runs of numbers, short and long."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from can_bridge.wire.messages import Mode
from firmware_sim.runs.run_log import COLUMNS, BusTotals, BusTraffic, NodeErrors, RunLog
from firmware_sim.runs.statistics import averages

STEP, LEAD_IN, CONTROLLED = 0.2, 60, 100  # t_c, and periods
FREQUENCY = 0.2  # of the lift without control, 1/t_c: a cycle is 25 periods
NODES = {
    "vehicle": NodeErrors(state="ERROR_ACTIVE", tx_errors=8, rx_errors=1, bus_off=0, refused=0),
    "ECU": NodeErrors(state="ERROR_PASSIVE", tx_errors=130, rx_errors=0, bus_off=2, refused=3),
}
averaged: Any = averages  # of runs that have averages
TRAFFIC = BusTraffic(
    load=0.3125, frames=4321, error_frames=7, longest_wait_ms={"Pressure": 0.5, "JetCommand": 1.25}, nodes=NODES
)


@pytest.fixture
def log_of(run_metadata) -> Callable[..., RunLog]:
    """A run of six periods of 0.2 t_c; columns not given are zero."""

    def make(enabled_at: int = 2, settle: float = 0.4, **columns) -> RunLog:
        series = {name: np.zeros(6) for name in COLUMNS} | {"t": 100.0 + 0.2 * np.arange(6.0)}
        series |= {name: np.array(values, dtype=float) for name, values in columns.items()}
        bus, metadata = BusTotals(sent=12, lost=1, rejected=2), replace(run_metadata, settle=settle)
        return RunLog(series=series, enabled_at=enabled_at, bus=bus, traffic=TRAFFIC, metadata=metadata)

    return make


@pytest.fixture
def shedding(run_metadata) -> Callable[..., RunLog]:
    return partial(shedding_log, run_metadata)


def shedding_log(metadata, Cd=0.88, Cl=0.1, *, action=0.05, modes=None, reasons=None, skipped=(), **changes) -> RunLog:
    """A run of 160 periods, control requested after 60, settled 20 later. Without control Cd is 1.1 and Cl a sine of
    amplitude 1; under control they are `Cd` and `Cl`, numbers or series, the jets work, and the ECU is in CONTROL.
    `modes` and `reasons` replace those of the periods they name, counted from the request; `changes` are of the
    metadata."""
    count = LEAD_IN + CONTROLLED
    series = {name: np.zeros(count) for name in COLUMNS} | {"t": STEP * np.arange(float(count))}
    # The sample at the request is still of the wake without control.
    before, under = slice(LEAD_IN + 1), slice(LEAD_IN + 1, None)
    series["Cd"][before], series["Cd"][under] = 1.1, np.asarray(Cd)
    series["Cl"][before] = np.sin(2.0 * np.pi * FREQUENCY * series["t"][before] - 1.0)
    series["Cl"][under] = np.asarray(Cl)
    series["action"][LEAD_IN + 1 :] = action
    series["mode"][LEAD_IN:] = Mode.CONTROL
    series["step_ms"] += 2.0
    series["age_ms"] += 8.3
    for offset, mode in (modes or {}).items():
        series["mode"][LEAD_IN + offset] = mode
    for offset, reason in (reasons or {}).items():
        series["reason"][LEAD_IN + offset] = reason
    for offset in skipped:
        series["step_ms"][LEAD_IN + offset] = np.nan
    changed = replace(metadata, **{"settle": 4.0, **changes})
    bus = BusTotals(sent=320, lost=1, rejected=2)
    return RunLog(series=series, enabled_at=LEAD_IN, bus=bus, traffic=TRAFFIC, metadata=changed)
