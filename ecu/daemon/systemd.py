"""The reports to systemd: datagrams to the socket that systemd names (sd_notify(3)), without systemd's library.

The watchdog is signalled only after completed control steps, so that systemd restarts a process whose loop hangs.
"""

import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Final

PER_INTERVAL: Final = 4
"""Number of watchdog signals within systemd's timeout; sd_watchdog_enabled(3) recommends 2."""


class Notifier:
    """A sender of notifications to systemd. It sends nothing unless systemd has set NOTIFY_SOCKET in the environment.
    It sends watchdog signals only if WATCHDOG_USEC is set, and WATCHDOG_PID does not name another process."""

    def __init__(self, environment: Mapping[str, str], pid: int) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        self._socket: socket.socket | None = None
        if self._address.startswith(("/", "@")):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)
        interval = environment.get("WATCHDOG_USEC", "")
        is_ours = environment.get("WATCHDOG_PID", str(pid)) == str(pid)
        self._interval_ns = int(interval) * 1000 // PER_INTERVAL if is_ours and interval.isdecimal() else 0
        self._due_ns = 0

    def ready(self, status: str) -> None:
        """Report that the jets can be controlled from now on."""
        self._tell(f"READY=1\nSTATUS={status}")

    def status(self, text: str) -> None:
        """Set the line that `systemctl status` shows."""
        # A line break in the text would begin another assignment.
        self._tell(f"STATUS={' '.join(text.split())}")

    def came_through(self, now_ns: int) -> None:
        """Signal the watchdog if a signal is due at `now_ns`, the end of a control step."""
        if self._interval_ns and now_ns >= self._due_ns:
            self._due_ns = now_ns + self._interval_ns
            self._tell("WATCHDOG=1")

    def stopping(self) -> None:
        self._tell("STOPPING=1")

    def close(self) -> None:
        """Close the socket; later notifications are not sent."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _tell(self, text: str) -> None:
        if self._socket is None:
            return
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        # A failed notification must not affect the control loop; without signals systemd restarts the process.
        with suppress(OSError):
            self._socket.sendto(text.encode(errors="backslashreplace"), address)
