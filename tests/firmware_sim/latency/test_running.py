"""Processes that do not do what they should: each ends in one line, and none is left behind."""

import sys
from pathlib import Path

import pytest

from contract.errors import BusError, StillwakeError
from firmware_sim.latency import running
from firmware_sim.latency.running import recorded
from tests.firmware_sim.latency.conftest import PERIOD

pytestmark = pytest.mark.processes

READY = """
import os, signal, socket, sys, time
socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM).sendto(b"READY=1\\nSTATUS=OFF", os.environ["NOTIFY_SOCKET"])
"""


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def ran(folder: Path, ecu: str, vehicle: str = "") -> None:
    recorded(
        folder,
        ecu=python(ecu),
        vehicle=python(vehicle),
        periods=10,
        period_ns=PERIOD,
        progress=lambda done: None,
    )


def test_an_ecu_that_does_not_start_is_quoted(tmp_path):
    with pytest.raises(BusError, match=r"the ecu did not start: error: no such bus$"):
        ran(tmp_path, "import sys; print('a line'); print('error: no such bus', file=sys.stderr); sys.exit(1)")
    with pytest.raises(BusError, match="the ecu did not start: it printed nothing"):
        ran(tmp_path, "")
    with pytest.raises(StillwakeError, match="cannot start the ecu: No such file"):
        recorded(
            tmp_path, ecu=["/no/such/program"], vehicle=[], periods=1, period_ns=PERIOD, progress=lambda done: None
        )


def test_a_process_that_ends_too_early_ends_the_others(tmp_path):
    with pytest.raises(BusError, match="the ecu ended before the vehicle: bus on fire"):
        ran(tmp_path, READY + "time.sleep(0.5); print('bus on fire')", "import time; time.sleep(20)")
    with pytest.raises(BusError, match="the vehicle failed: error: no recording"):
        ran(tmp_path, READY + "print(os.getpid(), flush=True); time.sleep(60)", "print('error: no recording'); exit(1)")
    pid = int((tmp_path / "ecu.log").read_text())
    assert not Path(f"/proc/{pid}").exists()


def test_an_ecu_that_ignores_its_end_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr(running, "END_S", 0.5)
    deaf = READY + "signal.signal(signal.SIGTERM, signal.SIG_IGN); print(os.getpid(), flush=True)\ntime.sleep(60)"
    with pytest.raises(BusError, match="the ecu did not end within 0 s"):
        ran(tmp_path, deaf, "import time; time.sleep(1)")
    pid = int((tmp_path / "ecu.log").read_text())
    assert not Path(f"/proc/{pid}").exists()


def test_processes_that_leave_no_table(tmp_path):
    with pytest.raises(StillwakeError, match=r"vehicle_times\.npz"):
        ran(tmp_path, READY + "time.sleep(60)", "import time; time.sleep(1)")
