"""How long the ECU's control steps took, over the latest periods."""

from collections import deque
from math import isfinite
from typing import Final

import numpy as np

from can_bridge.wire.messages import Mode
from firmware_sim.live.loop.messages import LatencyNow
from firmware_sim.runs.run_log import Row

BINS: Final = 50
_RANGE: Final = 1.25
"""Greatest edge, in budgets; what took longer is counted in the last bin."""
ON_THIS_MACHINE: Final = "wall clock of the step on this machine"
MODELLED: Final = "modelled cycles of the Cortex-M7"


class LatencyHistogram:
    """Times of steps that planned, of one ECU, because times of two do not compare.

    Args:
        budget_ms: of the bundle.
        kept: latest periods.
    """

    def __init__(self, budget_ms: float, kept: int) -> None:
        self._budget_ms = budget_ms
        self._edges = np.linspace(0.0, _RANGE * budget_ms, BINS + 1)
        self._times: deque[float] = deque(maxlen=kept)
        self._age_ms: float | None = None
        self._of = ON_THIS_MACHINE

    def start(self, *, modelled: bool) -> None:
        """Begin with another ECU."""
        self._times.clear()
        self._of = MODELLED if modelled else ON_THIS_MACHINE

    def add(self, row: Row, planned_ns: int | None, actuator_delay_ms: float) -> None:
        """After a period; `planned_ns` is what the step took in virtual time, None if it did not plan."""
        taken_ms = float("nan")
        if planned_ns is not None and row.mode == Mode.CONTROL:
            taken_ms = planned_ns / 1e6 if self._of == MODELLED else row.step_ms
        self._times.append(taken_ms)
        if isfinite(row.age_ms):
            self._age_ms = row.age_ms + actuator_delay_ms

    def message(self, run: int) -> LatencyNow:
        """As of now."""
        times = np.array(self._times, dtype=float)
        times = times[np.isfinite(times)]
        counts, _ = np.histogram(np.minimum(times, self._edges[-1]), self._edges)
        p50, p99, most = np.percentile(times, [50, 99, 100]).tolist() if len(times) else (None, None, None)
        return {
            "type": "latency",
            "run": run,
            "of": self._of,
            "edges": self._edges.tolist(),
            "counts": counts.tolist(),
            "budget_ms": self._budget_ms,
            "p50": p50,
            "p99": p99,
            "max": most,
            "over_budget": int((times > self._budget_ms).sum()),
            "sample_to_jets_ms": self._age_ms,
        }
