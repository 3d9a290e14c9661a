"""What passes between the running loop and a viewer: the messages by their types, and the picture's bytes.

The loop speaks on one channel: JSON messages, each with its `type`, and the flow's picture as bytes (`pack_field`). A
viewer speaks on a channel of its own, one request a message, and gets one answer to each.

    hello, periods, now   `firmware_sim.live.present`
    bus                   `firmware_sim.live.loop.bus_table`
    events                `run`, and new `items`: n, which counts up, time_s, t, text, and the kind: "set" by a viewer,
                          "state" of the ECU, "vehicle", "bus", "loop"
    settings              `settings`, of `LiveSettings`; after every change
    loop                  `state` of the loop's process: starting, running, busy (with what takes seconds), ended (for
                          good); `text`, one line on what is waited for, or why it ended. First on the channel

Of `loop`, `hello`, `now`, `bus`, `settings` and the picture the latest one is all that a viewer needs; of
`periods` and `events` it needs every one. After a `hello`, what came before it is of another run, or comes again.
A number that is none is null.
"""

import struct
from typing import Any, Final, NamedTuple

from wake.pictures.level_picture import Levels

LIVE_SCHEMA: Final = "stillwake-live/1"
_FIELD: Final = struct.Struct("<IfHH")

PERIOD_COLUMNS: Final = (
    "k", "t", "Cd", "Cl", "base_Cp", "action", "command", "predicted_Cd", "mode", "reason", "step_ms", "age_ms",
    "requested",
)  # fmt: skip
"""Columns of `periods`: `firmware_sim.runs.run_log.Row`, with its number from 0 and whether control was requested."""

LiveMessage = dict[str, Any]
Request = dict[str, Any]
"""A viewer's request: an `id`, which the answer has, too, and one of `firmware_sim.live.settings.ACTIONS`."""
LiveAnswer = dict[str, Any]
"""`id`; `error` is one line, and then nothing was changed; `note` reports what was done."""
Choice = dict[str, Any]
"""A controller or plant: `name`, `label`, and `missing`, one line on why it cannot be chosen here, or null."""


class FieldPicture(NamedTuple):
    """The flow at the start of period k, time t in t_c. `levels` are (height, width),
    `wake.pictures.level_picture.field_levels`."""

    k: int
    t: float
    levels: Levels


def pack_field(picture: FieldPicture) -> bytes:
    """Little-endian: k (uint32), t (float32), width, height (uint16), then the levels row by row (int8)."""
    height, width = picture.levels.shape
    return _FIELD.pack(picture.k, picture.t, width, height) + picture.levels.tobytes()
