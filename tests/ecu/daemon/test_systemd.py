"""sd_notify(3), heard by a socket of our own."""

import os
import socket
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from ecu.daemon.systemd import Notifier
from tests.each import each


class Systemd:
    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + address[1:] if address.startswith("@") else address)
        self._socket.setblocking(False)

    def heard(self) -> list[str]:
        messages = []
        with suppress(BlockingIOError):
            while True:
                messages.append(self._socket.recv(4096).decode())
        return messages

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[Systemd]:
    end = Systemd(str(tmp_path / "notify"))
    yield end
    end.close()


def test_it_sends_what_the_protocol_has(tmp_path):
    for address in (str(tmp_path / "notify"), f"@stillwake-test-{os.getpid()}"):
        systemd, notifier = Systemd(address), Notifier({"NOTIFY_SOCKET": address}, pid=1)
        notifier.ready("OFF")
        # A status of several lines is one assignment; a path need not be UTF-8.
        notifier.status("bus lost:\nREADY=1 \udcff")
        notifier.stopping()
        notifier.close()
        notifier.status("too late")
        assert systemd.heard() == ["READY=1\nSTATUS=OFF", "STATUS=bus lost: READY=1 \\udcff", "STOPPING=1"], address
        systemd.close()


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


@each(
    "environment",
    [
        *({"NOTIFY_SOCKET": "here"} | item for item in ({}, {"WATCHDOG_USEC": "1000", "WATCHDOG_PID": "8"})),
        *({"NOTIFY_SOCKET": "here", "WATCHDOG_USEC": item} for item in ("soon", "0")),
        *({}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "vsock:2:1"}),
    ],
)
def test_without_systemd_or_a_watchdog_of_this_process_there_are_none(systemd, environment):
    here = {name: systemd.address if value == "here" else value for name, value in environment.items()}
    notifier = Notifier(here, pid=7)
    notifier.came_through(10**12)
    notifier.close()
    assert systemd.heard() == []
