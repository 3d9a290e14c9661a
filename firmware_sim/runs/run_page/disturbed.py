"""When a run was disturbed, in its control periods: read from the texts of its disturbances."""

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from firmware_sim.runs.run_log import RunLog

_SENSOR: Final = re.compile(r"^(\w+):(?:.*,)?sensor=([^,]+)")


class Disturbed(NamedTuple):
    """A disturbance over a stretch of a run.

    Attributes:
        what: its text without its time.
        first, after: first period that it may act in, and the one after the last.
    """

    what: str
    first: int
    after: int

    @property
    def sensor(self) -> tuple[str, str] | None:
        """(name, kind) of the one sensor that it is of; None for every other disturbance."""
        match = _SENSOR.match(self.what)
        return None if match is None else (match[2], match[1])


def disturbed(log: RunLog) -> Iterator[Disturbed]:
    """In the order in which they were given. One without a time lasts from the begin to the end."""
    count = len(log.series["t"])
    for fault in log.metadata.faults:
        what, _, span = fault.text.partition("@")
        begin, _, end = span.partition("..")
        first, after = _period(log, begin), _period(log, end)
        yield Disturbed(what, 0 if first is None else min(first, count - 1), count if after is None else after)


def _period(log: RunLog, seconds: str) -> int | None:
    """The first one at or after a time of the run; None where the text has none."""
    try:
        return max(0, int(-(-float(seconds) * 1e9 // log.metadata.config.period_ns)))
    except (ValueError, OverflowError):
        return None
