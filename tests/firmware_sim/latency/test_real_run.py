"""ECU, vehicle and idle loop as they are, on a bus: an ECU that is held up shows with every period that it cost."""

import os
import signal
import sys
import time

import numpy as np
import psutil
import pytest

from contract.config.tree import Config
from firmware_sim.latency.measured import Measured
from firmware_sim.latency.running import ECU, IDLE, recorded
from firmware_sim.latency.stages import CHAIN, Stage
from tests.firmware_sim.latency.conftest import COUNTERS

pytestmark = [pytest.mark.processes]

PERIODS = 280
STOPPED_S = 0.2


def stop(name: str) -> None:
    """Hold up one of this process's children."""
    (child,) = [one for one in psutil.Process().children() if name in " ".join(one.cmdline())]
    os.kill(child.pid, signal.SIGSTOP)
    time.sleep(STOPPED_S)
    os.kill(child.pid, signal.SIGCONT)


def test_an_ecu_that_stands_still(tmp_path):
    period_ns = Config().period_ns
    high, low = divmod(os.getpid() % 65536, 256)
    bus = ["--set", "bus.interface=udp_multicast", "--set", f"bus.channel=239.255.{high}.{low}"]
    stillwake = [sys.executable, "-m", "stillwake"]
    done: list[int] = []

    def disturb(periods: int) -> None:
        if not done and "CONTROL" in (tmp_path / f"{ECU}.log").read_text():
            done.append(periods)
            time.sleep(1.0)
            stop("stillwake ecu")

    tables = recorded(
        tmp_path,
        ecu=[*stillwake, "ecu", *bus],
        vehicle=[*stillwake, "vehicle", "--periods", str(PERIODS), "--enable-after", "2", *bus],
        periods=PERIODS,
        period_ns=period_ns,
        progress=disturb,
    )
    assert done
    found = Measured.of(tables, name="onnx", about="", period_ns=period_ns, counter_period=COUNTERS)
    periods = found.periods
    # 200 ms hold ten sampling instants. The first may have been served before, and two may find the ECU awake again.
    # Periods that a latched ECU answers without a plan have no time in all; there may be more of them than it slept.
    planned = np.isfinite(periods.stages[Stage.ALL])
    answered, of = np.unique(periods.answered[planned], return_counts=True)
    assert of.max() >= 8
    together = np.flatnonzero(planned & (periods.answered == answered[of.argmax()]))
    assert set(together[:-1]) <= set(periods.missed)
    waits = periods.stages[Stage.ALL][together]
    assert waits.max() > 0.8 * STOPPED_S * 1e9
    np.testing.assert_array_equal(np.diff(waits), -period_ns)
    total = np.sum([periods.stages[stage] for stage in CHAIN], axis=0)
    whole = np.isfinite(total)
    assert whole.sum() > 30
    np.testing.assert_array_equal(total[whole], periods.stages[Stage.ALL][whole])
    assert (tmp_path / f"{IDLE}.log").read_text()
