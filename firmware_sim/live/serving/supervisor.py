"""Keeps the loop going for its viewers: its process, its messages, the requests that wait for an answer."""

import asyncio
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import count
from typing import Any, Final

from contract.errors import StillwakeError
from firmware_sim.live.loop.messages import Answer, Message
from firmware_sim.live.serving.hub import Hub
from firmware_sim.live.serving.process import LoopProcess
from firmware_sim.live.serving.stepping import MakeSession

SHORT_LIFE_S: Final = 20.0
"""A loop that ends sooner after its start is not started again: it would end again."""
MOST_WAITING: Final = 32
"""Requests of all viewers that the loop has not answered yet."""
STARTING: Final = "the loop starts; the first time, the flow solver is compiled, which takes a minute"


class Supervisor:
    """Supervises one loop; for one event loop, in which all but `hub` is used.

    Args:
        fast: whether a period may take less time than it does on a vehicle.
        report: called with each line on what is waited for, and on why the loop ended; from any thread.
    """

    def __init__(
        self,
        make: MakeSession,
        *,
        fast: bool = False,
        report: Callable[[str], None] = lambda line: None,
        short_life_s: float = SHORT_LIFE_S,
    ) -> None:
        self.hub = Hub()
        self._make, self._fast, self._report, self._short_life_s = make, fast, report, short_life_s
        self._watching = set[asyncio.Event]()
        self._waiting = dict[int, asyncio.Future[Answer]]()
        self._numbers = count(1)
        self._process: LoopProcess | None = None
        self._is_waking = False
        self._why = ""

    async def run(self) -> None:
        """Start the loop, and start it again where it fails, until this is cancelled; then it is ended.

        Raises:
            Exception: the loop's, which ended shortly after its start.
        """
        self._events = asyncio.get_running_loop()
        self._sender = ThreadPoolExecutor(1, thread_name_prefix="requests")
        try:
            while True:
                began = time.monotonic()
                error = await self._until_it_ends()
                self._why = f"the loop ended: {error}"
                if time.monotonic() - began < self._short_life_s:
                    self._put("ended", self._why)
                    raise error
        finally:
            self._sender.shutdown(wait=False, cancel_futures=True)

    async def _until_it_ends(self) -> Exception:
        ended: asyncio.Future[Exception] = self._events.create_future()
        process = LoopProcess(
            self._make,
            fast=self._fast,
            hear=self._heard,
            answered=lambda *answer: self._later(self._settle, *answer),
            ended=lambda error: self._later(_resolve, ended, error),
        )
        again = f"{self._why}; " if self._why else ""
        self._put("starting", again + STARTING)
        process.start()
        self._process = process
        try:
            return await ended
        finally:
            self._process = None
            for number in list(self._waiting):
                self._settle(number, {"error": "the loop has ended"})
            # Not awaited where this is cancelled: the process is to be gone when this returns.
            process.end()

    async def ask(self, request: str) -> Answer:
        """What the loop answers to a request as JSON; it takes as long as the loop needs for it."""
        process = self._process
        if process is None:
            return {"error": "the loop has ended"}
        if len(self._waiting) >= MOST_WAITING:
            return {"error": f"{MOST_WAITING} requests wait for the loop already: ask again when it has answered"}
        number = next(self._numbers)
        answer: asyncio.Future[Answer] = self._events.create_future()
        self._waiting[number] = answer
        try:
            await self._events.run_in_executor(self._sender, process.ask, number, request)
            return await answer
        except StillwakeError as error:
            return {"error": str(error)}
        finally:
            self._waiting.pop(number, None)

    @contextmanager
    def watched(self) -> Iterator[asyncio.Event]:
        """An event that is set whenever the hub has something new."""
        event = asyncio.Event()
        self._watching.add(event)
        try:
            yield event
        finally:
            self._watching.discard(event)

    def _heard(self, messages: Sequence[Message | bytes]) -> None:
        """In the thread that listens."""
        self.hub.put(messages)
        for message in messages:
            if isinstance(message, bytes):
                continue
            if message["type"] == "loop" and message["text"]:
                self._report(message["text"])
            if message["type"] == "hello" and self._why:
                # What is kept begins with this `hello`; that the loop had ended is to be seen later, too. The number is
                # below those of the session, which a page takes to go up.
                item = {"n": -1, "time_s": 0.0, "t": 0.0, "kind": "loop", "text": self._why}
                self.hub.put([{"type": "events", "run": message["run"], "items": [item]}])
                self._why = ""
        # One call at a time waits for the event loop, however much is sent meanwhile.
        if not self._is_waking:
            self._is_waking = True
            self._later(self._wake)

    def _put(self, state: str, text: str) -> None:
        self.hub.put([{"type": "loop", "state": state, "text": text}])
        self._report(text)
        self._wake()

    def _wake(self) -> None:
        self._is_waking = False
        for event in self._watching:
            event.set()

    def _settle(self, number: int, answer: Answer) -> None:
        future = self._waiting.get(number)
        if future is not None:
            _resolve(future, answer)

    def _later(self, call: Callable[..., None], *arguments: Any) -> None:
        self._events.call_soon_threadsafe(call, *arguments)


def _resolve(future: "asyncio.Future[Any]", value: Any) -> None:
    if not future.done():
        future.set_result(value)
