"""ECU, vehicle and idle loop as processes on a bus: one that is held up shows, one that fails ends in one line."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from contract.config.tree import Config
from contract.errors import BusError, StillwakeError
from firmware_sim.latency import running
from firmware_sim.latency.measured import Measured
from firmware_sim.latency.running import ECU, recorded
from firmware_sim.latency.stages import CHAIN, Stage
from tests.firmware_sim.latency.tables import COUNTERS, PERIOD

pytestmark = pytest.mark.processes

PERIODS = 270
STOPPED_S = 0.2
READY = """
import os, signal, socket, sys, time
socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM).sendto(b"READY=1\\nSTATUS=OFF", os.environ["NOTIFY_SOCKET"])
"""


@pytest.mark.proofs  # five seconds of three processes
def test_an_ecu_that_is_held_up_shows_with_every_period_that_it_cost(tmp_path, short_release):
    period_ns = Config().period_ns
    high, low = divmod(os.getpid() % 65536, 256)
    bus = ["--set", "bus.interface=udp_multicast", "--set", f"bus.channel=239.255.{high}.{low}"]
    stillwake = [sys.executable, "-m", "stillwake"]
    enabled = ("--enable-after", "1")
    done: list[int] = []

    def disturb(periods: int) -> None:
        if done or "CONTROL" not in (tmp_path / f"{ECU}.log").read_text():
            return
        done.append(periods)
        time.sleep(1.0)
        (child,) = [one for one in psutil.Process().children() if "stillwake ecu" in " ".join(one.cmdline())]
        os.kill(child.pid, signal.SIGSTOP)
        time.sleep(STOPPED_S)
        os.kill(child.pid, signal.SIGCONT)

    tables = recorded(
        tmp_path,
        ecu=[*stillwake, "ecu", str(short_release), *bus],
        vehicle=[*stillwake, "vehicle", "--bundle", str(short_release), "--periods", str(PERIODS), *enabled, *bus],
        periods=PERIODS,
        period_ns=period_ns,
        progress=disturb,
    )
    assert done
    run = Measured.of(tables, name="onnx", about="", period_ns=period_ns, counter_period=COUNTERS)
    periods = run.periods
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
    # The idle loop ran with the same deadlines, and never woke early.
    assert (run.idle_late >= 0.0).all() and len(run.idle_late) > PERIODS / 2
    assert "no garbage collection" in tables.privileges


def test_a_process_that_fails_ends_in_one_line_and_the_others_with_it(tmp_path, monkeypatch):
    def python(code: str) -> list[str]:
        return [sys.executable, "-c", code]

    cases: list[tuple[list[str], str, str]] = [
        (python("print('a line'); exit('error: no such bus')"), "", r"the ecu did not start: error: no such bus$"),
        (python(""), "", "the ecu did not start: it printed nothing"),
        (["/no/such/program"], "", "cannot start the ecu: No such file"),
        (
            python(READY + "time.sleep(0.5); print('bus on fire')"),
            "import time; time.sleep(20)",
            "the ecu ended before the vehicle: bus on fire",
        ),
        (
            python(READY + "print(os.getpid(), flush=True); time.sleep(60)"),
            "print('error: no recording'); exit(1)",
            "the vehicle failed: error: no recording",
        ),
        (python(READY + "time.sleep(60)"), "import time; time.sleep(1)", r"vehicle_times\.npz"),
        (
            python(READY + "signal.signal(15, signal.SIG_IGN); print(os.getpid(), flush=True)\ntime.sleep(60)"),
            "import time; time.sleep(1)",
            "the ecu did not end within 0 s",
        ),
    ]
    for ecu, vehicle, message in cases:
        if "SIG_IGN" in ecu[-1]:
            monkeypatch.setattr(running, "END_S", 0.5)
        with pytest.raises((BusError, StillwakeError), match=message):
            recorded(tmp_path, ecu=ecu, vehicle=python(vehicle), periods=10, period_ns=PERIOD, progress=lambda _: None)
        if "getpid" in ecu[-1]:
            pid = int((tmp_path / "ecu.log").read_text())
            assert not Path(f"/proc/{pid}").exists(), message
