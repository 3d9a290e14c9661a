"""ECU, vehicle and idle loop as processes on a bus: what fails ends in one line."""

import sys
from pathlib import Path
from typing import Any

import pytest

from contract.errors import BusError, StillwakeError
from firmware_sim.latency import running
from firmware_sim.latency.running import recorded
from tests.firmware_sim.latency.test_stages import PERIOD

pytestmark = pytest.mark.processes
READY = """
import os, signal, socket, sys, time
socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM).sendto(b"READY=1\\nSTATUS=OFF", os.environ["NOTIFY_SOCKET"])
"""
SHOWN = READY + "print(os.getpid(), flush=True); "
SHORT, LONG = (f"import time; time.sleep({seconds})" for seconds in (1, 20))


def test_a_process_that_fails_ends_in_one_line_and_the_others_with_it(tmp_path, monkeypatch):
    def python(code: str) -> list[str]:
        return [sys.executable, "-c", code]

    cases: list[tuple[list[str], Any, str]] = [
        (python("print('a line'); exit('error: no such bus')"), "", r"the ecu did not start: error: no such bus$"),
        (python(""), "", "the ecu did not start: it printed nothing"),
        (["/no/such/program"], "", "cannot start the ecu: No such file"),
        (python(READY + "time.sleep(0.5); print('bus off')"), LONG, "the ecu ended before the vehicle: bus off"),
        (python(SHOWN + "time.sleep(60)"), "print('error: no tape'); exit(1)", "the vehicle failed: error: no tape"),
        (python(READY + "time.sleep(60)"), SHORT, r"vehicle_times\.npz"),
        (python(SHOWN + "signal.signal(15, signal.SIG_IGN); time.sleep(60)"), SHORT, "the ecu did not end within 0 s"),
    ]
    cases = [(ecu, python(vehicle), message) for ecu, vehicle, message in cases]
    # In place of the idle loop, which the command's own test starts, a process that takes no time to start.
    (idle := tmp_path / "idle").write_text("#!/bin/sh\nexec sleep 60\n")
    idle.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(idle))
    for ecu, vehicle, message in cases:
        if "SIG_IGN" in ecu[-1]:
            monkeypatch.setattr(running, "END_S", 0.5)
        with pytest.raises((BusError, StillwakeError), match=message):
            recorded(tmp_path, ecu=ecu, vehicle=vehicle, periods=10, period_ns=PERIOD, progress=lambda _: None)
        if "getpid" in ecu[-1]:
            pid = int((tmp_path / "ecu.log").read_text())
            assert not Path(f"/proc/{pid}").exists(), message
