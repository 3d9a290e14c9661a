"""The execution of one run: ECU, vehicle and idle loop as separate processes, and the tables that they write."""

import os
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from contract.errors import BusError, StillwakeError
from ecu.real_time.stage_times import EcuStage, VehicleStage, load
from firmware_sim.latency.idle_loop import IdleStage
from firmware_sim.latency.stages import Times

READY_S: Final = 120.0
"""Longest time in s that the ECU may take to open the bundle, compile and warm up; a busy machine needs 30 s."""
END_S: Final = 30.0
"""Longest time in s that a process may take to write its table after it was asked to end."""
OVERTIME: Final = 2.0
START_S: Final = 60.0
"""Longest time that the vehicle may take: `OVERTIME` times the length of the run, plus `START_S` seconds to start."""
ECU, VEHICLE, IDLE = "ecu", "vehicle", "idle"


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """The tables of one run, the idle loop's privileges as text, and the line in the ECU's log about the last fault."""

    vehicle: Times
    ecu: Times
    idle: Times
    privileges: str
    fault: str


def longest_run(periods: int, period_ns: int) -> int:
    """Return the number of periods after which the ECU and the idle loop end by themselves."""
    return round(OVERTIME * periods + (START_S + END_S) * 1e9 / period_ns)


def recorded(
    folder: Path,
    *,
    ecu: Sequence[str],
    vehicle: Sequence[str],
    periods: int,
    period_ns: int,
    progress: Callable[[int], None],
) -> Recorded:
    """Run the three processes until the vehicle's process ends, and write tables and logs into the existing folder.
    `ecu` and `vehicle` are commands without `--stage-times`; the ECU must report to $NOTIFY_SOCKET when it is ready.
    `progress` is called with the number of periods done, about twice a second. Raises BusError, with the last line of a
    process that failed, ended too early or did not end; StillwakeError if it cannot be started, or its table read."""
    tables = {name: folder / f"{name}_times.npz" for name in (ECU, VEHICLE, IDLE)}
    with ExitStack() as stack:
        # The ECU reports on this socket that it is ready (sd_notify(3)).
        place = stack.enter_context(tempfile.TemporaryDirectory(prefix="stillwake-"))
        notified = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
        notified.bind(address := str(Path(place) / "notify"))
        command = [*ecu, "--stage-times", str(tables[ECU])]
        running_ecu = stack.enter_context(_Child(ECU, command, folder, notify=address))
        _wait_until_ready(notified, running_ecu)
        command = [*vehicle, "--stage-times", str(tables[VEHICLE])]
        running_vehicle = stack.enter_context(_Child(VEHICLE, command, folder))
        length = str(longest_run(periods, period_ns))
        baseline = [sys.executable, "-m", "firmware_sim.latency.idle_loop", str(tables[IDLE]), str(period_ns), length]
        idle = stack.enter_context(_Child(IDLE, baseline, folder))
        _wait(running_vehicle, (running_ecu, idle), periods=periods, period_ns=period_ns, progress=progress)
        for child in (running_ecu, idle):
            child.end()
    return Recorded(
        vehicle=load(tables[VEHICLE], VehicleStage),
        ecu=load(tables[ECU], EcuStage),
        idle=load(tables[IDLE], IdleStage),
        privileges=idle.last_line,
        fault=running_ecu.last_line_with("FAULT") or "its log names no fault",
    )


def _wait(
    vehicle: "_Child", others: Sequence["_Child"], *, periods: int, period_ns: int, progress: Callable[[int], None]
) -> None:
    began = time.monotonic()
    longest_s = START_S + OVERTIME * periods * period_ns / 1e9
    while vehicle.process.poll() is None:
        for other in others:
            if other.process.poll() is not None:
                raise BusError(f"the {other.name} ended before the vehicle: {other.last_line}")
        passed_s = time.monotonic() - began
        if passed_s > longest_s:
            raise BusError(f"the vehicle has not ended after {passed_s:.0f} s: {vehicle.last_line}")
        progress(min(periods, int(passed_s * 1e9 / period_ns)))
        with suppress(subprocess.TimeoutExpired):
            vehicle.process.wait(0.5)
    if vehicle.process.returncode:
        raise BusError(f"the vehicle failed: {vehicle.last_line}")
    progress(periods)


class _Child:
    """A child process with a log in the folder. Leaving the context ends the process if it still runs."""

    def __init__(self, name: str, command: Sequence[str], folder: Path, *, notify: str | None = None) -> None:
        self.name = name
        self._log = folder / f"{name}.log"
        environment = {key: value for key, value in os.environ.items() if key not in ("NOTIFY_SOCKET", "WATCHDOG_USEC")}
        # With more threads, numerical libraries would wait actively and take processor time from other processes.
        environment |= {"OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
        if notify is not None:
            environment["NOTIFY_SOCKET"] = notify
        try:
            with self._log.open("wb") as log:
                # In its own group, the process gets no Ctrl-C: the parent process ends its child processes in order.
                self.process = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment, process_group=0
                )
        except OSError as error:
            raise StillwakeError(f"cannot start the {name}: {error.strerror or error}") from error

    @property
    def last_line(self) -> str:
        return self.last_line_with("") or "it printed nothing"

    def last_line_with(self, word: str) -> str:
        """Return the last printed line that contains this word, or an empty text."""
        lines = self._log.read_text(encoding="utf-8", errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip() and word in line), "")

    def end(self) -> None:
        """Ask the process to end, and wait until it has written its table."""
        self.process.terminate()
        try:
            self.process.wait(END_S)
        except subprocess.TimeoutExpired as error:
            raise BusError(f"the {self.name} did not end within {END_S:.0f} s: {self.last_line}") from error

    def __enter__(self) -> "_Child":
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            with suppress(BusError):
                self.end()
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


def _wait_until_ready(notified: socket.socket, child: _Child) -> None:
    """Wait until the process is ready; raises BusError if it ends earlier or is not ready within READY_S."""
    deadline = time.monotonic() + READY_S
    while time.monotonic() < deadline:
        readable, _, _ = select.select([notified], [], [], 0.2)
        if readable and b"READY=1" in notified.recv(4096).split(b"\n"):
            return
        if child.process.poll() is not None:
            raise BusError(f"the {child.name} did not start: {child.last_line}")
    raise BusError(f"the {child.name} was not ready within {READY_S:.0f} s: {child.last_line}")
