"""sd_notify(3), heard by a socket of our own."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_sim.ecu.daemon.systemd import Notifier
from tests.each import each


class Systemd:
    """Its end of the socket."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + address[1:] if address.startswith("@") else address)
        self._socket.setblocking(False)

    def heard(self) -> list[str]:
        found = []
        while True:
            try:
                found.append(self._socket.recv(4096).decode())
            except BlockingIOError:
                return found

    def close(self) -> None:
        self._socket.close()


@pytest.fixture(params=["path", "abstract"])
def systemd(request, tmp_path: Path) -> Iterator[Systemd]:
    address = str(tmp_path / "notify") if request.param == "path" else f"@stillwake-test-{os.getpid()}"
    end = Systemd(address)
    yield end
    end.close()


def test_a_status_of_several_lines_is_one_assignment(systemd):
    Notifier({"NOTIFY_SOCKET": systemd.address}, pid=1).status("bus lost:\nREADY=1")
    assert systemd.heard() == ["STATUS=bus lost: READY=1"]


def test_it_says_what_the_protocol_has(systemd):
    notifier = Notifier({"NOTIFY_SOCKET": systemd.address}, pid=1)
    notifier.ready("OFF")
    notifier.status("CONTROL")
    notifier.stopping()
    assert systemd.heard() == ["READY=1\nSTATUS=OFF", "STATUS=CONTROL", "STOPPING=1"]
    notifier.close()
    notifier.status("too late")
    assert systemd.heard() == []


def test_signs_of_life_come_four_times_an_interval_and_only_by_steps(systemd):
    notifier = Notifier({"NOTIFY_SOCKET": systemd.address, "WATCHDOG_USEC": "200000", "WATCHDOG_PID": "7"}, pid=7)
    heard = []
    for step in range(1, 101):
        notifier.came_through(step * 20_000_000)
        heard.append(systemd.heard())
    # 2 s of steps every 20 ms, a sign each 50 ms at most: at every third step.
    assert heard == ([["WATCHDOG=1"], [], []] * 34)[:100]
    notifier.status("no step")
    assert "WATCHDOG=1" not in systemd.heard()


@pytest.mark.parametrize(
    "environment",
    [{}, {"WATCHDOG_USEC": "1000", "WATCHDOG_PID": "8"}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": "0"}],
)
def test_without_a_watchdog_of_this_process_there_are_none(systemd, environment):
    notifier = Notifier({"NOTIFY_SOCKET": systemd.address} | environment, pid=7)
    notifier.came_through(10**12)
    assert systemd.heard() == []


@each("environment", [{}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "vsock:2:1"}])
def test_without_systemd_it_says_nothing(environment):
    notifier = Notifier(environment, pid=1)
    notifier.ready("OFF")
    notifier.came_through(1)
    notifier.close()
