"""The bus commands beside independent clients, python-can's logger and player, on real sockets.

Both ends are processes of their own on `udp_multicast`, at a port of the test's own: on Linux python-can hears every
group that anyone on the machine has joined at its port, and one bad datagram of another test ends its logger.
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

import can
import pytest
from can.interfaces.udp_multicast import UdpMulticastBus

from tests.stillwake.commands.can.virtual_bus import write

pytestmark = pytest.mark.processes

PERIODS = 50
PATIENCE_S = 60.0
GROUP = "239.74.163.2"
BUS = ("--set", "bus.interface=udp_multicast", "--set", f"bus.channel={GROUP}")
AT_PORT = """
import sys
sys.modules["asammdf"] = None
from can.interfaces.udp_multicast import UdpMulticastBus
init = UdpMulticastBus.__init__
assert 43113 in init.__defaults__
init.__defaults__ = tuple(PORT if one == 43113 else one for one in init.__defaults__)
from stillwake.__main__ import main
main()
"""
"""`stillwake`, where python-can's udp_multicast has another port by default: it is no setting of ours. Without asammdf,
which python-can imports for MF4 files in more time than all else takes."""
TOOL = "import runpy, sys; sys.modules['asammdf'] = None; runpy.run_module(sys.argv.pop(1), run_name='__main__')"
"""One of python-can's, likewise."""


@pytest.fixture
def bus() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What a command of ours begins with on a bus of this test alone, and the options of python-can's tools."""
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
    return (
        (sys.executable, "-c", AT_PORT.replace("PORT", str(port)), "can"),
        ("-i", "udp_multicast", "-c", GROUP, "--fd", "--bus-kwargs", f"port={port}", "hop_limit=0"),
    )


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


def test_can_logger_and_our_monitor_hear_all_that_send_and_can_player_send(cli, tmp_path, bus):
    (ours, theirs), output, made = bus, tmp_path / "got.blf", write(tmp_path / "sent.asc", PERIODS)
    logging = (sys.executable, "-c", TOOL, "can.logger", *theirs, "-f", str(output))
    with running(*logging) as logger, running(*ours, "monitor", *BUS) as monitor:
        assert "Connected to" in first_line(logger)
        first_line(monitor)
        for command in (
            [*ours, "send", "Pressure", "Age=1.5", "--count", "50", "--period", "0.002", *BUS],
            [sys.executable, "-c", TOOL, "can.player", *theirs, "--", str(tmp_path / "sent.asc")],
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
