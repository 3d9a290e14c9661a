"""A session that needs no flow: it counts, answers, and fails where it is asked to."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

from contract.errors import PlantError, StillwakeError
from firmware_sim.live.loop.messages import PERIOD_COLUMNS, LiveAnswer, LiveMessage, Request

PICTURE_BYTES = 90_000


def hello(run: int = 1) -> LiveMessage:
    return {"type": "hello", "run": run, "period_ms": 5.0}


def periods(*numbers: int, run: int = 1) -> LiveMessage:
    return {"type": "periods", "run": run, "columns": {name: [float(k) for k in numbers] for name in PERIOD_COLUMNS}}


class FakeSession:
    def __init__(self, show: Callable[[str], None]) -> None:
        self.show = show
        self.new: list[LiveMessage | bytes] = [hello()]
        self.k = 0
        self.paused = False
        self.order = ""

    def step(self) -> None:
        if self.order == "diverge":
            raise PlantError("the flow diverged at t = 1.0")
        if self.order == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if not self.paused:
            self.new += [periods(self.k), bytes(PICTURE_BYTES)]
            self.new += [{"type": "now", "k": self.k, "t": float("nan")}]
            self.k += 1

    def handle(self, request: Request) -> LiveAnswer:
        given = request.get("set", {})
        if "order" in given:
            self.order = given["order"]
        if "wait" in given:
            self.show("something takes long")
            _until_there_is(given["wait"])
        if "pause" in request:
            self.paused = request["pause"]
        return LiveAnswer(note=f"at {self.k}")

    def before(self, request: Request) -> Callable[[], None] | None:
        awaited = request.get("set", {}).get("make")
        if awaited is None:
            return None

        def make() -> None:
            self.show("something is made")
            _until_there_is(awaited)
            if "fail" in request["set"]:
                raise StillwakeError("it cannot\nbe made")

        return make

    def messages(self) -> list[LiveMessage | bytes]:
        new, self.new = self.new, []
        return new


def _until_there_is(path: str) -> None:
    """Wait for a file: what comes first is then up to the test, however slow the machine is."""
    while not Path(path).exists():
        time.sleep(0.005)
