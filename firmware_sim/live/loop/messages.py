"""The types of the messages between the running loop and a viewer.

The loop sends on one channel: JSON messages, each with its `type`, and pictures of the flow as bytes
(`firmware_sim.live.loop.live_run.pack_field`). A viewer sends on a separate channel, one request per message, and gets
one answer to each request.

    hello, periods, now   `firmware_sim.live.present`
    bus                   `firmware_sim.live.loop.bus_table`
    events                `run`, and new `items`, each with an increasing number n, time_s, t, text, and the kind: "set"
                          (by a viewer), "state" (of the ECU), "vehicle", "bus" or "loop"
    settings              `settings`, a `LiveSettings`; this message is sent after every change
    loop                  `state` of the loop's process: starting, running, busy (for some seconds) or ended; `text`:
                          one line about the present work or the process's end; a viewer gets this message first

A viewer needs only the latest `loop`, `hello`, `now`, `bus`, `settings` and picture, but all `periods` and `events`. At
`hello` a viewer discards all earlier data: they belong to another run, or are sent again. NaN and infinity are null.
"""

from collections.abc import Iterable, Sequence
from typing import Any, Final

PERIOD_COLUMNS: Final = (
    "k", "t", "Cd", "Cl", "base_Cp", "action", "command", "predicted_Cd", "mode", "reason", "step_ms", "age_ms",
    "requested",
)  # fmt: skip
"""Columns of `periods`: fields of `firmware_sim.runs.run_log.Row`, the period's number, and the request for control."""
KEPT_PERIODS: Final = 3000
"""Number of latest periods that a page should store; session and server store the same number."""
LiveMessage = dict[str, Any]
Request = dict[str, Any]
"""A viewer's request: an `id`, which the answer repeats, and an action of `firmware_sim.live.settings.ACTIONS`."""
LiveAnswer = dict[str, Any]
"""An answer: the request's `id`; `error` if the request changed nothing; `note` if the change needs an explanation."""
Choice = dict[str, Any]
"""A controller or plant to choose from: `name`, `label`, and `missing`, null or the reason why it cannot be chosen."""


def periods_message(run: int, rows: Iterable[Sequence[float | None]]) -> LiveMessage:
    """Return the message `periods` with these rows; each row has one value per column in `PERIOD_COLUMNS`."""
    columns = [list(column) for column in zip(*rows, strict=True)]
    return {"type": "periods", "run": run, "columns": dict(zip(PERIOD_COLUMNS, columns, strict=True))}
