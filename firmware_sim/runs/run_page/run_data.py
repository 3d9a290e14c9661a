"""The data of a run for the script of its page: constants, series, events, and the recorded wake."""

import base64
import re
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from can_bridge.wire.messages import Reason
from contract.arrays import Array
from contract.geometry import HALF_WIDTH, JET_WIDTH
from firmware_sim.runs.control import SKIPPED, mode_spans, set_aside
from firmware_sim.runs.reasons import BECAUSE, DOES
from firmware_sim.runs.run_log import WALL, RunLog
from firmware_sim.runs.statistics import NoAverages, averages, latency, planned_steps, rounded, sample_to_jets_ms
from firmware_sim.runs.wake_stills import WakeStills
from wake.pictures.drawing import outline

_SENSOR: Final = re.compile(r"^(\w+):(?:.*,)?sensor(s?)=([^,]+)")
MOST_EVENTS: Final = 400
"""Largest number of events on a page; on a bus that loses frames, the mode can change very often."""
_DOES: Final = {**DOES, SKIPPED: "the ECU was still computing or booting, and skipped the period"}
_COLUMNS: Final = ("t", "Cd", "Cl", "base_Cp", "action", "mode", "step_ms", "speed")
_DIGITS: Final = 5  # number of decimals of the values; further decimals would not be visible on any screen
_BINS: Final = 60


class Disturbed(NamedTuple):
    """A disturbance in the periods `first` .. `after` - 1. `what` is its `--disturb` text before the "@"."""

    what: str
    first: int
    after: int

    @property
    def sensors(self) -> list[tuple[str, str]]:
        """Each sensor that the disturbance names, with the disturbance's kind."""
        if (match := _SENSOR.match(self.what)) is None:
            return []
        kind, several, text = match.groups()
        return [(name, kind) for name in (text.split("+") if several else [text])]


def disturbed(log: RunLog) -> Iterator[Disturbed]:
    """Yield the disturbances in the order given. A disturbance without a time spans the whole run."""
    count = len(log.series["t"])
    for fault in log.metadata.faults:
        what, _, span = fault.text.partition("@")
        begin, _, end = span.strip().removesuffix("s").partition("..")
        first, after = _period(log, begin), _period(log, end)
        yield Disturbed(what, 0 if first is None else min(first, count - 1), count if after is None else after)


def _period(log: RunLog, seconds: str) -> int | None:
    """Return the first period that starts at or after a time in s, given as text; None if the text is not a time."""
    try:
        return max(0, -(-round(float(seconds) * 1e9) // log.metadata.config.period_ns))
    except (ValueError, OverflowError):
        return None


class RunEvent(NamedTuple):
    """An event at the start of a period. `kind` is "set" for a change from outside, "state" for a change of the ECU."""

    period: int
    kind: str
    text: str


def events(log: RunLog) -> list[RunEvent]:
    """Return at most `MOST_EVENTS` events in order of time. The last event states how many are left out."""
    happened = sorted([*_set(log), *_states(log)], key=lambda event: event.period)
    if len(happened) <= MOST_EVENTS:
        return happened
    rest = f"and {len(happened) - MOST_EVENTS + 1} events more"
    return [*happened[: MOST_EVENTS - 1], RunEvent(happened[MOST_EVENTS - 1].period, "state", rest)]


def _set(log: RunLog) -> Iterator[RunEvent]:
    last = len(log.series["t"]) - 1
    if log.enabled_at <= last:
        yield RunEvent(log.enabled_at, "set", "control is requested")
    for what, first, after in disturbed(log):
        yield RunEvent(first, "set", f"disturbed by {what}")
        if after <= last:
            yield RunEvent(after, "set", f"no longer disturbed by {what}")


def _states(log: RunLog) -> Iterator[RunEvent]:
    reasons = log.series["reason"].astype(int)
    for name, period in set_aside(log):
        yield RunEvent(period, "state", f"{name} is set aside: it contradicts the others, and is estimated from them")
    before = None
    for mode, first, _ in mode_spans(log):
        because = BECAUSE[Reason(int(reasons[first]))]
        change = mode if before is None else f"{before} to {mode}"
        because = f"{because}; " if because and mode != SKIPPED else ""
        yield RunEvent(first, "state", f"{change}: {because}{_DOES[mode]}")
        before = mode


def run_data(log: RunLog, wake: WakeStills | None, name: str) -> dict[str, Any]:
    """Return the data for the scripts in `page/` as JSON values without NaN. `wake` is None if there are no stills."""
    config, means = log.metadata.config, averages(log)
    return {
        "name": name,
        "period": config.flow.control_period,
        "period_s": config.period_ns / 1e9,
        "action_limit": config.flow.action_limit,
        "drive": log.metadata.drive,
        "requested": log.enabled_at if log.enabled_at < len(log.series["t"]) else None,
        "uncontrolled_Cd": None if isinstance(means, NoAverages) else means.before.Cd,
        "columns": {column: _numbers(log.series[column]) for column in _COLUMNS},
        "spans": [[mode, first, after] for mode, first, after in mode_spans(log)],
        "events": [list(event) for event in events(log)],
        "marks": [[*sensor, one.first, one.after] for one in disturbed(log) for sensor in one.sensors],
        "latency": _latency(log),
        "sensors": list(log.metadata.sensors),
        "wall": _numbers(log.series[WALL].T) if WALL in log.series else None,
        **({"scene": None, "wake": None} if wake is None else _recorded(log, wake)),
    }


def _recorded(log: RunLog, wake: WakeStills) -> dict[str, Any]:
    config, (width, height) = log.metadata.config, wake.scene.size
    slot = HALF_WIDTH - 0.5 * JET_WIDTH
    scene = {
        "view": list(wake.scene.view),
        "body": _numbers(outline(config.body)),
        "jets": [[config.body.length, slot], [config.body.length, -slot]],
        "sensors": [{"name": name, "x": x, "y": y} for name, (x, y) in wake.scene.sensors.items()],
        "used": list(log.metadata.sensors),
        "action_limit": config.flow.action_limit,
    }
    stills = [base64.b64encode(still).decode("ascii") for still in wake.stills]
    return {"scene": scene, "wake": {"width": width, "height": height, "k": wake.k.tolist(), "stills": stills}}


def _latency(log: RunLog) -> dict[str, Any]:
    """Return the histogram that `latency_histogram.js` draws: wall-clock times of the control steps, in ms."""
    budget, timing = log.metadata.budget_ms, latency(log)
    taken = log.series["step_ms"][planned_steps(log)]
    edges = np.linspace(0.0, max(budget, float(np.max(taken, initial=0.0))), _BINS + 1)
    emulated = log.metadata.ecu.clock_mhz is not None
    return {
        "of": "wall clock of the step's emulation" if emulated else "wall clock of the step on the machine of the run",
        "edges": _numbers(edges),
        "counts": np.histogram(taken, edges)[0].tolist(),
        "budget_ms": budget,
        **{name: rounded(getattr(timing, name)) for name in ("p50", "p99", "max")},
        "over_budget": None if emulated else timing.over_budget,
        "sample_to_jets_ms": rounded(sample_to_jets_ms(log)),
    }


def _numbers(values: Array) -> list[Any]:
    rounded = np.round(values, _DIGITS).astype(object)
    rounded[~np.isfinite(np.asarray(values, dtype=float))] = None
    return list(rounded.tolist())
