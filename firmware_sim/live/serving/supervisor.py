"""A supervisor that runs the loop's process, stores the loop's messages once for all viewers, and passes on requests. A
`Viewer` stores only its position in the streams, so a slow viewer needs no more memory than a fast viewer."""

import asyncio
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import count, islice
from typing import Any, Final

from contract.errors import StillwakeError
from firmware_sim.live.loop.messages import KEPT_PERIODS, PERIOD_COLUMNS, LiveAnswer, LiveMessage, periods_message
from firmware_sim.live.serving.process import LONGEST_END_S, MakeSession, started

PICTURE: Final = "picture"
STREAMS: Final = ("loop", "hello", "settings", "events", "periods", "now", "bus", PICTURE)
"""The order in which a viewer gets the streams; `hello` states the run to which the later streams belong."""
MOST_ROWS: Final = 500
"""Largest number of periods, or of events, in one message. A longer message would keep a new viewer waiting."""
_KEPT: Final = {"events": 500, "periods": KEPT_PERIODS}  # items; of another stream only the newest one
SHORT_LIFE_S: Final = 20.0
"""Shortest time in s for which a loop must have run to be started again after a failure."""
MOST_WAITING: Final = 32
"""Largest number of requests, of all viewers together, that the loop has not answered yet."""
STARTING: Final = "the loop starts; the first time, the flow solver is compiled, which takes a minute"


class Hub:
    """The newest items of each stream. A stream's items are counted from its start, also those no longer stored."""

    def __init__(self) -> None:
        self._streams = {stream: deque[Any](maxlen=_KEPT.get(stream, 1)) for stream in STREAMS}
        self._counts = dict.fromkeys(STREAMS, 0)
        self._run = 0

    def put(self, messages: Iterable[LiveMessage | bytes]) -> None:
        for message in messages:
            if isinstance(message, bytes):
                self._add(PICTURE, [message])
            elif message["type"] == "periods":
                columns = (message["columns"][name] for name in PERIOD_COLUMNS)
                self._add("periods", list(zip(*columns, strict=True)))
            elif message["type"] == "events":
                self._add("events", message["items"])
            else:
                if message["type"] == "hello":
                    self._run = message["run"]
                    for stream in ("events", "periods", "now", "bus", PICTURE):
                        self._streams[stream].clear()
                self._add(message["type"], [message])

    def _add(self, stream: str, items: Sequence[Any]) -> None:
        self._streams[stream].extend(items)
        self._counts[stream] += len(items)

    def after(self, stream: str, count: int) -> tuple[LiveMessage | bytes | None, int]:
        """Return what a stream received after its first `count` items (or None), and the count for the next call."""
        kept, last = self._streams[stream], self._counts[stream]
        first = last - len(kept)
        begin = max(count, first)
        items = list(islice(kept, begin - first, begin - first + MOST_ROWS))
        count = begin + len(items)
        if not items:
            return None, count
        if stream == "periods":
            return periods_message(self._run, items), count
        if stream == "events":
            return {"type": "events", "run": self._run, "items": items}, count
        return items[-1], count


class Viewer:
    """The position of one viewer in the streams of a hub; it stores counts and no messages."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._counts = dict.fromkeys(STREAMS, 0)

    def take(self, stream: str) -> LiveMessage | bytes | None:
        """Return new content of a stream for this viewer, or None: the newest message or, for periods and events, up to
        `MOST_ROWS` of the oldest items that the hub still stores and the viewer has not received."""
        message, self._counts[stream] = self._hub.after(stream, self._counts[stream])
        if stream == "hello" and message is not None:
            # A page discards its data at a `hello`, so the stored data of the streams after `hello` are sent again.
            self._counts |= dict.fromkeys(STREAMS[STREAMS.index("hello") + 1 :], 0)
        return message


class Supervisor:
    """The supervisor of one loop, for use inside one event loop. `report` is called with a line about any work for
    which viewers have to wait, and with the reason if the loop ends. When the hub gets new content, the event `changed`
    is set and replaced."""

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
        self.changed = asyncio.Event()
        self._waiting = dict[int, asyncio.Future[LiveAnswer]]()
        self._numbers = count(1)
        self._send: Callable[[tuple[int, str]], asyncio.Future[None]] | None = None
        self._why = ""

    async def run(self) -> None:
        """Start the loop, and start it again after a failure, until this task is cancelled; then end the loop. Raises
        the error of a loop that ended shortly after its start."""
        while True:
            began = time.monotonic()
            error = await self._until_it_ends()
            self._why = f"the loop ended: {error}"
            if time.monotonic() - began < self._short_life_s:
                self._put("ended", self._why)
                raise error

    async def _until_it_ends(self) -> Exception:
        """Run the loop's process, and return the error with which it ended."""
        again = f"{self._why}; " if self._why else ""
        self._put("starting", again + STARTING)
        in_thread = asyncio.get_running_loop().run_in_executor
        # The end of this block waits on purpose: when a cancelled task returns, the process must have ended.
        with (
            ThreadPoolExecutor(1, "answers") as receiving,
            ThreadPoolExecutor(1, "requests") as sending,
            started(self._make, fast=self._fast) as (process, pipe),
        ):
            self._send = lambda request: in_thread(sending, pipe.send, request)
            try:
                while True:
                    kind, content = await in_thread(receiving, pipe.recv)
                    if kind == "messages":
                        self._hear(content)
                    elif kind == "answer":
                        self._settle(*content)
                    else:
                        error: Exception = content
                        return error
            except (EOFError, OSError):
                process.join(LONGEST_END_S)
                status = process.exitcode
                how = f"with status {status}" if status is None or status >= 0 else f"by {signal.Signals(-status).name}"
                return StillwakeError(f"the loop's process ended {how}")
            finally:
                self._send = None
                for number in list(self._waiting):
                    self._settle(number, {"error": "the loop has ended"})

    async def ask(self, request: str) -> LiveAnswer:
        """Send a request in JSON to the loop, wait for the loop's answer, and return it."""
        if self._send is None:
            return {"error": "the loop has ended"}
        if len(self._waiting) >= MOST_WAITING:
            return {"error": f"{MOST_WAITING} requests wait for the loop already: ask again when it has answered"}
        number = next(self._numbers)
        answer: asyncio.Future[LiveAnswer] = asyncio.get_running_loop().create_future()
        self._waiting[number] = answer
        try:
            await self._send((number, request))
            return await answer
        except OSError:
            return {"error": "the loop has ended"}
        finally:
            self._waiting.pop(number, None)

    def _hear(self, messages: Sequence[LiveMessage | bytes]) -> None:
        self.hub.put(messages)
        for message in messages:
            if isinstance(message, bytes):
                continue
            if message["type"] == "loop" and message["text"]:
                self._report(message["text"])
            if message["type"] == "hello" and self._why:
                # This `hello` has deleted the stored events, so the previous loop's end is added again for later
                # viewers. A page expects increasing numbers, so this event's number is below all other numbers.
                item = {"n": -1, "time_s": 0.0, "t": 0.0, "kind": "loop", "text": self._why}
                self.hub.put([{"type": "events", "run": message["run"], "items": [item]}])
                self._why = ""
        self.changed.set()
        self.changed = asyncio.Event()

    def _put(self, state: str, text: str) -> None:
        self._hear([{"type": "loop", "state": state, "text": text}])

    def _settle(self, number: int, answer: LiveAnswer) -> None:
        future = self._waiting.get(number)
        if future is not None and not future.done():
            future.set_result(answer)
