"""Keeps the loop going for its viewers: its process, its messages, the requests that wait for an answer.

The hub keeps the newest value of each stream, and rings of what a viewer must not miss, once for all viewers. A
`Viewer` holds how far it has come, so a slow one costs as much as a quick one.
"""

import asyncio
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import count
from threading import Lock
from typing import Any, Final

from contract.errors import StillwakeError
from firmware_sim.live.loop.messages import PERIOD_COLUMNS, LiveAnswer, LiveMessage
from firmware_sim.live.serving.process import LoopProcess, MakeSession

PICTURE: Final = "picture"
STREAMS: Final = ("loop", "hello", "settings", "events", "periods", "now", "bus", PICTURE)
"""The order in which a viewer gets them: `hello` names the run that the others belong to."""
MOST_ROWS: Final = 500
"""Periods, or events, in one message: what a viewer that has just come waits for stays small."""
KEPT_EVENTS: Final = 500
KEPT_PERIODS: Final = 3000
"""The periods that are kept until a `hello` gives a number."""
_OF_A_RUN: Final = ("now", "bus", PICTURE)


class Hub:
    """Takes the loop's messages, and returns what is new since a count. Threads may share it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._latest = dict[str, tuple[int, LiveMessage | bytes]]()
        self._periods, self._events = Ring(KEPT_PERIODS), Ring(KEPT_EVENTS)
        self._run = 0
        self._count = 0

    def put(self, messages: Iterable[LiveMessage | bytes]) -> None:
        """Keep what came, in its order."""
        with self._lock:
            for message in messages:
                self._keep(message)

    def after(self, stream: str, count: int) -> tuple[LiveMessage | bytes | None, int]:
        """What is new in a stream since its count was this, or None; and its count now."""
        with self._lock:
            if stream == "periods":
                rows, count = self._periods.after(count, MOST_ROWS)
                return (_periods(self._run, rows) if rows else None), count
            if stream == "events":
                items, count = self._events.after(count, MOST_ROWS)
                return ({"type": "events", "run": self._run, "items": items} if items else None), count
            newest, value = self._latest.get(stream, (0, None))
            return (value if newest > count else None), max(newest, count)

    def _keep(self, message: LiveMessage | bytes) -> None:
        self._count += 1
        if isinstance(message, bytes):
            self._latest[PICTURE] = (self._count, message)
        elif message["type"] == "periods":
            columns = message["columns"]
            self._periods.extend(zip(*(columns[name] for name in PERIOD_COLUMNS), strict=True))
        elif message["type"] == "events":
            self._events.extend(message["items"])
        else:
            if message["type"] == "hello":
                self._begin(message)
            self._latest[message["type"]] = (self._count, message)

    def _begin(self, hello: LiveMessage) -> None:
        """Forget what is of the run before."""
        self._run = hello["run"]
        self._periods.restart(hello["kept"])
        self._events.restart(KEPT_EVENTS)
        for stream in _OF_A_RUN:
            self._latest.pop(stream, None)


class Viewer:
    """How far one viewer of a hub has come: it holds counts and no messages, however long it does not read."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._counts = dict.fromkeys(STREAMS, 0)

    def take(self, stream: str) -> LiveMessage | bytes | None:
        """What this viewer has not had of one of `STREAMS`; None if nothing.

        Of latest values the newest. Of the others the oldest `MOST_ROWS` that the hub still has.
        """
        message, self._counts[stream] = self._hub.after(stream, self._counts[stream])
        if stream == "hello" and message is not None:
            # A page begins again with it. What was taken of the new run before its `hello` is wanted again.
            self._counts |= dict.fromkeys(STREAMS[STREAMS.index("hello") + 1 :], 0)
        return message


class Ring:
    """The newest items; each has a number from 1 on, in the order in which they came."""

    def __init__(self, kept: int) -> None:
        self._items = deque[Any](maxlen=kept)
        self._count = 0

    def extend(self, items: Iterable[Any]) -> None:
        """Newer items."""
        for item in items:
            self._items.append(item)
            self._count += 1

    def restart(self, kept: int) -> None:
        """Begin again with room for so many; the numbers go on."""
        self._items = deque(maxlen=kept)

    def after(self, count: int, most: int) -> tuple[list[Any], int]:
        """Take at most so many items with numbers above `count`, the oldest first, and the number of the last of them.

        Items that the ring no longer has are passed over.
        """
        first = self._count - len(self._items)
        begin = max(count, first)
        end = min(begin + most, self._count)
        return [self._items[i - first] for i in range(begin, end)], max(end, count)


def _periods(run: int, rows: list[tuple[float | None, ...]]) -> LiveMessage:
    columns = [list(column) for column in zip(*rows, strict=True)]
    return {"type": "periods", "run": run, "columns": dict(zip(PERIOD_COLUMNS, columns, strict=True))}


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
        self._waiting = dict[int, asyncio.Future[LiveAnswer]]()
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

    async def ask(self, request: str) -> LiveAnswer:
        """What the loop answers to a request as JSON; it takes as long as the loop needs for it."""
        process = self._process
        if process is None:
            return {"error": "the loop has ended"}
        if len(self._waiting) >= MOST_WAITING:
            return {"error": f"{MOST_WAITING} requests wait for the loop already: ask again when it has answered"}
        number = next(self._numbers)
        answer: asyncio.Future[LiveAnswer] = self._events.create_future()
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

    def _heard(self, messages: Sequence[LiveMessage | bytes]) -> None:
        """Keep new messages, in the thread that listens."""
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

    def _settle(self, number: int, answer: LiveAnswer) -> None:
        future = self._waiting.get(number)
        if future is not None:
            _resolve(future, answer)

    def _later(self, call: Callable[..., None], *arguments: Any) -> None:
        self._events.call_soon_threadsafe(call, *arguments)


def _resolve(future: "asyncio.Future[Any]", value: Any) -> None:
    if not future.done():
        future.set_result(value)
