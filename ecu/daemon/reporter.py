"""The thread that writes the log (text or JSON), the counters for Prometheus (text format 0.0.4) and freshness values.

The control loop never waits for this thread, because writing may block on a slow disk or a full pipe, or fail.
"""

import json
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Final, NamedTuple, Self

from can_bridge.e2e.receiver import FrameCheck
from can_bridge.wire.messages import Mode, Reason
from contract.atomic import replacing
from contract.errors import StillwakeError
from ecu.ecu_state import EcuState
from ecu.real_time.privileges import step_back


@dataclass(frozen=True, kw_only=True)
class Counters:
    """The counters after a control step, counted since the process started.

    Attributes:
        action: action that was sent last, in U_inf W.
        busy_ns: total time of all steps in ns, each from its waking until its frames were sent.
        latest_wake_ns: largest time in ns from a deadline until the loop woke.
    """

    state: EcuState
    steps: int = 0
    left_out: int = 0
    received: int = 0
    dropped: int = 0
    not_sent: int = 0
    losses: int = 0
    action: float = 0.0
    busy_ns: int = 0
    longest_ns: int = 0
    latest_wake_ns: int = 0


def text(c: Counters, *, bundle: str) -> str:
    """Return the content of the file of counters; `bundle` is the name of the release."""
    state, mode, reason = c.state, c.state.fail_safe.mode.on_wire, c.state.fail_safe.reason
    name_of_release = bundle.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    counts = {
        "steps": (c.steps, "Control steps."),
        "periods_left_out": (c.left_out, "Periods without a control step, because an earlier step was not finished."),
        "overruns": (state.overruns, "Whole periods that the ECU's own timing found missing."),
        "missed": (state.missed, "Steps without usable pressures."),
        "crc_errors": (state.pressures.count(FrameCheck.ERROR), "Pressure frames with a wrong CRC."),
        "repeated": (state.pressures.count(FrameCheck.REPEATED), "Pressure frames with a repeated counter."),
        "wrong_sequence": (state.pressures.count(FrameCheck.WRONG_SEQUENCE), "Pressure frames out of sequence."),
        "not_authentic": (state.verifier.refused, "Pressure frames refused by their MAC or freshness."),
        "frames_received": (c.received, "Frames of the ECU's messages."),
        "frames_dropped": (c.dropped, "Pressure frames lost because the queue was full."),
        "frames_not_sent": (c.not_sent, "Frames that the bus refused."),
        "bus_losses": (c.losses, "Times that the bus was lost."),
        "bus_off": (state.health.bus_off, "Times that the CAN controller was bus-off or the bus was lost."),
        "other_ecu_frames": (state.other_ecu.frames, "Commands and statuses of another ECU."),
        "busy_seconds": (c.busy_ns / 1e9, "Total time of all steps, from waking to the sent frames."),
    }
    gauges = {
        "action": (c.action, "Jets' action commanded last, U_inf W."),
        "longest_step_seconds": (c.longest_ns / 1e9, "Largest time from waking to the sent frames."),
        "latest_wake_seconds": (c.latest_wake_ns / 1e9, "Largest delay of a step's start after its deadline."),
        "tx_errors": (state.health.tx_errors, "Transmit error counter of the CAN controller."),
        "rx_errors": (state.health.rx_errors, "Receive error counter of the CAN controller."),
    }
    modes = {f'{{mode="{m.name}"}}': int(m is mode) for m in Mode}
    reasons = {f'{{reason="{r.name}"}}': int(r is reason) for r in Reason}
    return "".join(
        (
            _metric("info", "gauge", "The running release.", {f'{{bundle="{name_of_release}"}}': 1}),
            *(_metric(f"{name}_total", "counter", meaning, {"": value}) for name, (value, meaning) in counts.items()),
            *(_metric(name, "gauge", meaning, {"": value}) for name, (value, meaning) in gauges.items()),
            _metric("mode", "gauge", "1 for the mode on the bus.", modes),
            _metric("reason", "gauge", "1 for the reason on the bus.", reasons),
        )
    )


def _metric(name: str, kind: str, meaning: str, values: Mapping[str, float]) -> str:
    full = f"stillwake_ecu_{name}"
    samples = (f"{full}{label} {value!r}\n" for label, value in values.items())
    return f"# HELP {full} {meaning}\n# TYPE {full} {kind}\n{''.join(samples)}"


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
    """A thread that writes counters and log lines while its `with` block runs, and the remaining lines at the block's
    end. The control loop sets the counters after each step.

    Args:
        write: writes one line of the log; if it raises OSError or ValueError, the line is lost.
        bundle: name of the release in the file of counters, `metrics`.
        keep: stores freshness values, and may raise StillwakeError. It is called with the counters once per interval.
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
        # One line reports all periods that were skipped in an interval; another line reports all unsent frames.
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
