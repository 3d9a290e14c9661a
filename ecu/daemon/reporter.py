"""The thread for reports: log lines as text or as JSON, the file of counters, the freshness file.

The control loop never waits for this thread, because writing may block on a slow disk or a full pipe, or fail.
"""

import json
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Final, NamedTuple, Self

from contract.atomic import replacing
from contract.errors import StillwakeError
from ecu.daemon.counters import Counters, text
from ecu.real_time.privileges import step_back


class DatedEvent(NamedTuple):
    """An event with its date; `date_ns` is the time in ns since the Unix epoch."""

    date_ns: int
    name: str
    text: str
    fields: Mapping[str, str | int | float]


def plain(event: DatedEvent) -> str:
    """Return a line of text with the time in UTC: `12:34:56.789 ecu: bus lost: ...`."""
    text = " ".join(event.text.split())
    return f"{_moment(event):%H:%M:%S}.{event.date_ns // 1_000_000 % 1000:03d} ecu: {text}"


def as_json(event: DatedEvent) -> str:
    """Return a line of JSON: `time` (RFC 3339, UTC), `event`, `text`, and the event's fields."""
    stamp = f"{_moment(event):%Y-%m-%dT%H:%M:%S}.{event.date_ns // 1000 % 1_000_000:06d}Z"
    return json.dumps({"time": stamp, "event": event.name, "text": event.text, **event.fields})


def _moment(event: DatedEvent) -> datetime:
    return datetime.fromtimestamp(event.date_ns // 1_000_000_000, UTC)


INTERVAL_S: Final = 1.0
"""Time in s between two updates of the file of counters."""


class Reporter:
    """A thread that writes counters and log lines while its `with` block runs, and the remaining lines at its end. The
    control loop sets the counters after each step.

    Args:
        write: writes one line of the log; if it raises OSError or ValueError, the line is lost.
        bundle: name of the release in the file of counters, `metrics`.
        keep: stores freshness values, and may raise StillwakeError. It is called with the counters once an interval.
    """

    def __init__(
        self,
        write: Callable[[str], object],
        as_line: Callable[[DatedEvent], str],
        *,
        bundle: str,
        metrics: Path | None = None,
        keep: Callable[[Counters], None] = lambda counters: None,
        interval_s: float = INTERVAL_S,
    ) -> None:
        self._write, self._as_line = write, as_line
        self._metrics, self._keep, self._interval_s = metrics, keep, interval_s
        self.bundle = bundle
        self._events = SimpleQueue[DatedEvent | None]()
        self._thread = Thread(target=self._run, name="report", daemon=True)
        self._trouble: dict[str, str] = {}
        self._left_out = self._not_sent = 0
        self.counters: Counters | None = None

    def tell(self, name: str, line: str, **fields: str | int | float) -> None:
        """Report an event with the present time; the call does not wait."""
        self._events.put(DatedEvent(date_ns=time.time_ns(), name=name, text=line, fields=fields))

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._events.put(None)
        self._thread.join()

    def _run(self) -> None:
        step_back()
        due_s = time.monotonic() + self._interval_s
        while True:
            try:
                event = self._events.get(timeout=max(0.0, due_s - time.monotonic()))
            except Empty:
                self._look()
                due_s = time.monotonic() + self._interval_s
                continue
            if event is None:
                break
            self._write_line(event)
        self._look()
        with suppress(Empty):
            while (event := self._events.get_nowait()) is not None:
                self._write_line(event)

    def _write_line(self, event: DatedEvent) -> None:
        with suppress(OSError, ValueError):
            self._write(self._as_line(event))

    def _look(self) -> None:
        counters = self.counters
        if counters is None:
            return
        # All periods left out in an interval are reported in one line, and likewise all frames not sent.
        if (more := counters.left_out - self._left_out) > 0:
            self._left_out = counters.left_out
            self.tell("left_out", f"{more} periods left out, {counters.left_out} in all", more=more)
        if (more := counters.not_sent - self._not_sent) > 0:
            self._not_sent = counters.not_sent
            self.tell("not_sent", f"{more} frames not sent, {counters.not_sent} in all", more=more)
        if (path := self._metrics) is not None:
            self._attempt("metrics", lambda: _write_file(path, text(counters, bundle=self.bundle)))
        self._attempt("freshness", lambda: self._keep(counters))

    def _attempt(self, name: str, work: Callable[[], None]) -> None:
        """Call `work`. Report its first failure, and its first success after a failure."""
        try:
            work()
        except StillwakeError as error:
            if name not in self._trouble:
                self._trouble[name] = str(error)
                self.tell(f"{name}_failed", str(error))
        else:
            if self._trouble.pop(name, None) is not None:
                self.tell(f"{name}_written", f"{name} file written again")


def _write_file(path: Path, content: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(content, encoding="utf-8")
