"""What happened in a run, from its series: requests, changes of the ECU's mode with their reasons, disturbances."""

from collections.abc import Iterator
from typing import Final, NamedTuple

from can_bridge.wire.messages import Reason
from firmware_sim.runs.control import SKIPPED, set_aside
from firmware_sim.runs.pictures import mode_spans
from firmware_sim.runs.reasons import BECAUSE, DOES
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.run_page.disturbed import disturbed

MOST: Final = 400
"""Events of a page: a bus that loses frames changes the mode again and again."""

_DOES: Final = {**DOES, SKIPPED: "the ECU was still computing, and left the period out"}


class Event(NamedTuple):
    """At the start of a control period.

    Attributes:
        period: its index in the run's series.
        kind: "set" from outside, "state" of the ECU.
    """

    period: int
    kind: str
    text: str


def events(log: RunLog) -> list[Event]:
    """In order; the first `MOST`."""
    happened = sorted([*_set(log), *_states(log)], key=lambda event: event.period)
    if len(happened) <= MOST:
        return happened
    rest = f"and {len(happened) - MOST + 1} events more"
    return [*happened[: MOST - 1], Event(happened[MOST - 1].period, "state", rest)]


def _set(log: RunLog) -> Iterator[Event]:
    last = len(log.series["t"]) - 1
    if log.enabled_at <= last:
        yield Event(log.enabled_at, "set", "control is requested")
    for what, first, after in disturbed(log):
        yield Event(first, "set", f"disturbed by {what}")
        if after <= last:
            yield Event(after, "set", f"no longer disturbed by {what}")


def _states(log: RunLog) -> Iterator[Event]:
    reasons = log.series["reason"].astype(int)
    for name, period in set_aside(log):
        yield Event(period, "state", f"{name} is set aside: it contradicts the others, which stand in for it")
    before = None
    for mode, first, _ in mode_spans(log):
        because = BECAUSE[Reason(int(reasons[first]))]
        change = mode if before is None else f"{before} to {mode}"
        yield Event(first, "state", f"{change}: {f'{because}; ' if because and mode != SKIPPED else ''}{_DOES[mode]}")
        before = mode
