"""The bus commands beside independent clients, python-can's logger and player, on real sockets.

Both ends are processes of their own on `udp_multicast`, at a port of the test's own, which python-can's configuration
states: on Linux python-can hears every group that anyone on the machine has joined at its port, and one bad datagram of
another test ends its logger.
"""

import os
import re
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest
from can.interfaces.udp_multicast import UdpMulticastBus

from tests.stillwake.commands.can.virtual_bus import write

pytestmark = pytest.mark.processes

PERIODS = 50
PATIENCE_S = 60.0
GROUP = "239.74.163.2"
CONFIGURATION = "[default]\ninterface = udp_multicast\nchannel = {}\nport = {}\nhop_limit = 0\nfd = True\n"
RUN = "import runpy, sys; sys.modules['asammdf'] = None; runpy.run_module(sys.argv.pop(1), run_name='__main__')"
"""A module without asammdf, which python-can imports for MF4 files in more time than all else takes."""
STILLWAKE, BUS = (sys.executable, "-c", RUN, "stillwake", "can"), ("--set", "bus.interface=python-can")


@pytest.fixture
def home(tmp_path, monkeypatch) -> Path:
    """A home folder whose can.conf names a bus of this test alone."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_port:
        any_port.bind(("", 0))
        port = any_port.getsockname()[1]
    try:
        one, other = (UdpMulticastBus(GROUP, port=port, hop_limit=0, fd=True) for _ in range(2))
    except (can.CanError, OSError) as error:
        pytest.skip(f"no multicast here: {error}")
    with one, other:
        one.send(can.Message())
        if other.recv(1.0) is None:
            pytest.skip("multicast does not loop back here")
    (tmp_path / "can.conf").write_text(CONFIGURATION.format(GROUP, port))
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


@contextmanager
def running(*command: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        # Shells start background jobs deaf to Ctrl-C, and a test may run in one.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler) and None,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def first_line(process: subprocess.Popen[str]) -> str:
    """What it prints first: both loggers have opened the bus by then."""
    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], PATIENCE_S)
    assert ready, "nothing was printed"
    return process.stdout.readline()


def test_can_logger_and_our_monitor_hear_all_that_send_and_can_player_send(cli, home):
    output, made = home / "got.blf", write(home / "sent.asc", PERIODS)
    logging = (sys.executable, "-c", RUN, "can.logger", "-f", str(output))
    with running(*logging) as logger, running(*STILLWAKE, "monitor", *BUS) as monitor:
        assert "Connected to" in first_line(logger)
        first_line(monitor)
        for command in (
            [*STILLWAKE, "send", "Pressure", "Age=1.5", "--count", "50", "--period", "0.002", *BUS],
            [sys.executable, "-c", RUN, "can.player", str(home / "sent.asc")],
        ):
            subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)
        time.sleep(1.0)
        for process in (logger, monitor):
            process.send_signal(signal.SIGINT)
        logger.communicate(timeout=PATIENCE_S)
        out, err = monitor.communicate(timeout=PATIENCE_S)
    assert (monitor.returncode, err) == (0, "")
    assert f"{len(made) + 50} frames, " in out
    decoded = cli("can", "decode", output, "--summary").out
    assert re.search(rf"Pressure +{PERIODS + 50} ", decoded), decoded
    assert re.search(rf"JetCommand +{PERIODS} .* 0 OK {PERIODS}\b", decoded), decoded
