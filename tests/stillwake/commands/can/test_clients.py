"""The bus commands beside independent clients: python-can's logger and player, cantools; on real sockets and terminals.

Both ends are processes of their own on `udp_multicast`, at a port of the test's own: on Linux python-can hears every
group that anyone on the machine has joined at its port, and one bad datagram of another test ends its logger.
"""

import fcntl
import os
import pty
import re
import select
import signal
import socket
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import can
import pytest

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


@dataclass(frozen=True)
class Bus:
    """A bus of this test alone.

    Attributes:
        ours: what a command of ours begins with; its settings are `BUS`.
        theirs: options of python-can's tools and of `cantools monitor`.
    """

    ours: tuple[str, ...]
    theirs: tuple[str, ...]


@pytest.fixture
def bus() -> Bus:
    from can.interfaces.udp_multicast import UdpMulticastBus

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
    return Bus(
        ours=(sys.executable, "-c", AT_PORT.replace("PORT", str(port)), "can"),
        theirs=("-i", "udp_multicast", "-c", GROUP, "--fd", "--bus-kwargs", f"port={port}", "hop_limit=0"),
    )


@contextmanager
def running(*command: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        preexec_fn=_deaf_to_nothing,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def _deaf_to_nothing() -> None:
    # Shells start background jobs deaf to Ctrl-C, and a test may run in one.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def first_line(process: subprocess.Popen[str]) -> str:
    """What it prints first: both loggers have opened the bus by then."""
    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], PATIENCE_S)
    assert ready, "nothing was printed"
    return process.stdout.readline()


def ended(process: subprocess.Popen[str], number: int) -> tuple[int, str, str]:
    process.send_signal(number)
    out, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, out, err


def test_can_logger_and_our_monitor_hear_all_that_send_and_can_player_send(cli, tmp_path: Path, bus: Bus) -> None:
    output, made = tmp_path / "got.blf", write(tmp_path / "sent.asc", PERIODS)
    logging = (sys.executable, "-c", TOOL, "can.logger", *bus.theirs, "-f", str(output))
    with running(*logging) as logger, running(*bus.ours, "monitor", *BUS) as monitor:
        assert "Connected to" in first_line(logger)
        first_line(monitor)
        for command in (
            [*bus.ours, "send", "Pressure", "Age=1.5", "--count", "50", "--period", "0.002", *BUS],
            [sys.executable, "-c", TOOL, "can.player", *bus.theirs, "--", str(tmp_path / "sent.asc")],
        ):
            subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)
        time.sleep(1.0)
        ended(logger, signal.SIGINT)
        code, out, err = ended(monitor, signal.SIGINT)
    assert (code, err) == (0, "")
    assert f"{len(made) + 50} frames, " in out
    decoded = cli("can", "decode", output, "--summary").out
    assert re.search(rf"Pressure +{PERIODS + 50} ", decoded), decoded
    assert re.search(rf"JetCommand +{PERIODS} .* 0 OK {PERIODS}\b", decoded), decoded


def screen_of(command: Sequence[str], awaited: bytes) -> tuple[int, str]:
    """Run on a terminal, and interrupt it when the text has come."""
    controller, end = pty.openpty()
    fcntl.ioctl(end, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 100, 0, 0))
    # pytest's readline sets lines and columns.
    environment = {name: value for name, value in os.environ.items() if name not in ("LINES", "COLUMNS")}
    environment |= {"TERM": "xterm-256color", "PYTHONWARNINGS": "default"}
    written, deadline = b"", time.monotonic() + PATIENCE_S
    with subprocess.Popen(
        command, stdin=end, stdout=end, stderr=end, env=environment, preexec_fn=_deaf_to_nothing
    ) as process:
        os.close(end)
        with suppress(OSError):  # how a terminal ends
            while time.monotonic() < deadline and select.select([controller], [], [], PATIENCE_S)[0]:
                before, written = written, written + os.read(controller, 65536)
                if awaited in written and awaited not in before:
                    process.send_signal(signal.SIGINT)
        if time.monotonic() >= deadline:
            process.kill()
    os.close(controller)
    return process.returncode, written.decode(errors="replace")


def test_monitor_on_a_terminal_shows_what_passes_its_filter_until_it_is_interrupted(bus: Bus) -> None:
    with running(*bus.ours, "send", "JetCommand", "Flow=1.5", "--count", "100000", *BUS):
        code, out = screen_of([*bus.ours, "monitor", "--filter", "flow", *BUS], b"1.5")
    assert code == 0, out
    assert "filter: flow" in out
    assert "Enable" not in out
    # It draws over the picture before, ends below the last one, and puts the cursor back.
    assert "\x1b[1A" in out
    assert out.endswith("\n\x1b[?25h")
