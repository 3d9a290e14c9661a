"""The newest value of each stream, and rings of what a viewer must not miss: kept once for all viewers.

A `Viewer` holds how far it has come, so a slow one costs as much as a quick one.
"""

from collections import deque
from collections.abc import Iterable
from threading import Lock
from typing import Any, Final

from firmware_sim.live.loop.messages import PERIOD_COLUMNS, Message

PICTURE: Final = "picture"
STREAMS: Final = ("loop", "hello", "settings", "events", "periods", "now", "bus", PICTURE)
"""In the order in which a viewer gets them: `hello` names the run that the others belong to."""
MOST_ROWS: Final = 500
"""Periods, or events, in one message: what a viewer that has just come waits for stays small."""
KEPT_EVENTS: Final = 500
KEPT_PERIODS: Final = 3000
"""Until a `hello` gives a number."""
_OF_A_RUN: Final = ("now", "bus", PICTURE)


class Hub:
    """Takes the loop's messages, and returns what is new since a count. Threads may share it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._latest = dict[str, tuple[int, Message | bytes]]()
        self._periods, self._events = Ring(KEPT_PERIODS), Ring(KEPT_EVENTS)
        self._run = 0
        self._count = 0

    def put(self, messages: Iterable[Message | bytes]) -> None:
        """Keep what came, in its order."""
        with self._lock:
            for message in messages:
                self._keep(message)

    def after(self, stream: str, count: int) -> tuple[Message | bytes | None, int]:
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

    def _keep(self, message: Message | bytes) -> None:
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

    def _begin(self, hello: Message) -> None:
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

    def take(self, stream: str) -> Message | bytes | None:
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
        """At most so many items with numbers above `count`, the oldest first, and the number of the last of them.

        Items that the ring no longer has are passed over.
        """
        first = self._count - len(self._items)
        begin = max(count, first)
        end = min(begin + most, self._count)
        return [self._items[i - first] for i in range(begin, end)], max(end, count)


def _periods(run: int, rows: list[tuple[float | None, ...]]) -> Message:
    columns = [list(column) for column in zip(*rows, strict=True)]
    return {"type": "periods", "run": run, "columns": dict(zip(PERIOD_COLUMNS, columns, strict=True))}
