"""The messages in a run's log of frames: numbers and rates of frames, and results of the end-to-end checks."""

from typing import Final

from can_bridge.logs.log_reader import CanLog
from can_bridge.tools.observed_traffic import Traffic
from can_bridge.tools.raw_bus import id_text
from can_bridge.tools.summary import Summary
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_log import RunLog

_MOST_FRAMES: Final = 50_000
"""Largest number of frames in a log for which a page shows the messages; reading them takes ten seconds."""

_Rows = list[tuple[str, ...]]
BUS_HEADS: Final = ("identifier", "message", "frames", "per s", "lost", "end-to-end checks")


def bus_rows(folder: RunFolder, log: RunLog) -> _Rows:
    """Return a row for each identifier; no rows if the log is missing or too long. Raises StillwakeError for a damaged
    log."""
    if log.traffic.frames > _MOST_FRAMES or not folder.frames.is_file():
        return []
    bus = log.metadata.config.bus
    found = Summary(config=bus)
    for message in CanLog(folder.frames):
        found.add(message)
    return [_row(one) for _, one in sorted(found.messages.items())]


def _row(one: Traffic) -> tuple[str, ...]:
    checks = ", ".join(f"{text} {count}" for text, count in one.verdicts.items()) if one.is_protected else ""
    return (
        id_text(one.latest),
        one.name or "of another node",
        str(one.count),
        f"{one.mean_rate_hz:.1f}",
        str(one.lost) if one.is_protected else "",
        checks,
    )
