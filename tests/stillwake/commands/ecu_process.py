"""`stillwake ecu` as a process, whose log is read while it runs."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from tests.firmware_sim.ecu.daemon.driving import PATIENCE_S


@dataclass
class Process:
    """An ECU that runs, with the events and other lines of its log so far."""

    popen: "subprocess.Popen[str]"
    events: list[dict[str, Any]] = field(default_factory=list)
    other: list[str] = field(default_factory=list)

    def names(self) -> list[str]:
        return [event["event"] for event in self.events]

    def listen(self) -> None:
        assert self.popen.stderr is not None
        for line in self.popen.stderr:
            try:
                self.events.append(json.loads(line))
            except ValueError:
                self.other.append(line)

    def until(self, name: str) -> dict[str, Any]:
        begin = time.monotonic()
        while name not in self.names():
            assert time.monotonic() - begin < PATIENCE_S, f"{name} did not come: {self.names()}, {self.other}"
            assert self.popen.poll() is None, self.other
            time.sleep(0.005)
        return next(event for event in self.events if event["event"] == name)

    def ends(self, number: int) -> int:
        self.popen.send_signal(number)
        return self.popen.wait(PATIENCE_S)


@contextmanager
def process(*words: str, environment: Mapping[str, str] | None = None) -> Iterator[Process]:
    # More late steps than the window holds, of which a busy machine has many, never latch.
    patient = ("--set", "ecu.deadline_misses=11", "--log", "json")
    with subprocess.Popen(
        [sys.executable, "-m", "stillwake", "ecu", *words, *patient],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | (environment or {}),
        # Shells start background jobs deaf to Ctrl-C, and a test may run in one.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler) and None,
    ) as popen:
        its = Process(popen)
        listener = threading.Thread(target=its.listen)
        listener.start()
        try:
            yield its
        finally:
            popen.kill()
            listener.join(PATIENCE_S)
