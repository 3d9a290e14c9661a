"""What passes between the running loop and a viewer: the messages by their types, and the picture's bytes.

The loop speaks on one channel: JSON messages, each with its `type`, and the flow's picture as bytes (`pack_field`). A
viewer speaks on a channel of its own, one request a message, and gets one answer to each.

Of `loop`, `hello`, `now`, `bus`, `settings` and the picture the latest one is all that a viewer needs; of
`periods` and `events` it needs every one. After a `hello`, what came before it is of another run, or comes again.
A number that is none is null.
"""

import struct
from typing import Any, Final, Literal, NamedTuple, TypedDict

from wake.pictures.levels import Levels

SCHEMA: Final = "stillwake-live/1"
_FIELD: Final = struct.Struct("<IfHH")


class SensorPlace(TypedDict):
    """A wall sensor, in W: the nose at x = 0 as in the solver's coordinates."""

    name: str
    x: float
    y: float


class Choice(TypedDict):
    """A controller or plant; `missing` is one line on why it cannot be chosen here, or null."""

    name: str
    label: str
    missing: str | None


class Hello(TypedDict):
    """First on the channel, and again after the plant was changed: everything that stays."""

    type: Literal["hello"]
    schema: str
    version: str
    bundle: dict[str, str]  # name, digest (12 digits), precision, signer or ""
    run: int  # counts the plant's starts; k and t begin again with each
    period_ms: float
    convective_time_s: float
    control_period: float  # t_c
    action_limit: float  # U_inf W
    horizon: int
    delay_steps: int
    reynolds: float
    refinement: float  # of the grid
    plant: str  # description
    answers_jets: bool
    sensors: list[SensorPlace]  # all of the plant's
    used: list[str]  # names, in the order of the Pressure message
    body: list[list[float]]  # outline, x and y in W
    jets: list[list[float]]  # [x, y] of the upper and the lower slot
    view: list[float]  # x and y limits of the picture, W
    raster: list[int]  # its width and height; empty where the plant has no field
    states: list[str]  # of `OperatingMode`, in order
    reasons: dict[str, str]  # in words, by the names of `Reason`: `firmware_sim.runs.reasons`
    controllers: list[Choice]
    plants: list[Choice]
    sliders: dict[str, dict[str, Any]]  # `firmware_sim.live.settings.Slider`, by setting
    weights: dict[str, float]  # the release's
    weight_slider: dict[str, Any]
    settings: dict[str, Any]  # `LiveSettings.to_tree`
    kept: int  # periods that a page should keep


PERIOD_COLUMNS: Final = (
    "k", "t", "Cd", "Cl", "base_Cp", "action", "command", "predicted_Cd", "mode", "reason", "step_ms", "age_ms",
    "requested",
)  # fmt: skip
"""Columns of `Periods`: `firmware_sim.runs.run_log.Row`, with its number from 0 and whether control was requested."""


class Periods(TypedDict):
    """New control periods: a list of equal length for each of `PERIOD_COLUMNS`."""

    type: Literal["periods"]
    run: int
    columns: dict[str, list[float | None]]


class Now(TypedDict):
    """As of the latest period."""

    type: Literal["now"]
    run: int
    k: int
    t: float
    time_s: float
    state: str  # of `OperatingMode`; "UNPOWERED" without supply, "BOOT" while it starts
    reason: str  # of `Reason`
    misses: int
    lost: int  # of the latest loss_window periods
    set_aside: list[str]  # sensors that the ECU does not believe
    given_up: bool  # the vehicle has withdrawn its request by itself
    plan: list[float]  # actions of the next periods, from plan_from on; empty without a plan
    plan_from: int  # row of `Periods` in whose action and forces the first one would be seen
    forecast: list[list[float]]  # predicted Cd and Cl for the same periods
    cp: list[float]  # at all sensors
    read: list[float | None]  # Cp as the transducers read it, for `used`
    uncontrolled_Cd: float | None  # mean over whole cycles before control was first requested
    drag_Cd: float | None  # mean over the latest cycles
    reduction_percent: float | None
    fps: float  # control periods a second, by the wall clock
    real_time: float  # virtual seconds a second
    paused: bool
    computed_by: str


class BusRow(TypedDict):
    """A CAN identifier."""

    id: int
    name: str
    sender: str
    count: int
    rate_hz: float | None  # over the latest second of virtual time
    age_ms: float | None
    e2e: str  # last check of the receiver: OK, REPEATED, WRONG_SEQUENCE, ERROR, ... ; "" where there is none
    e2e_state: str  # NODATA, INIT, VALID, INVALID; "" where there is none
    errors: int  # checks that were not OK
    limit_ms: float | None  # cycle time by the DBC


class BusNow(TypedDict):
    """The bus over the latest second of virtual time."""

    type: Literal["bus"]
    run: int
    rows: list[BusRow]
    load: float  # 0 to 1
    error_frames: int  # of that second
    nodes: list[dict[str, Any]]  # name, state, tx_errors, rx_errors, bus_off, refused


class EventItem(TypedDict):
    """Something that happened, for people."""

    n: int  # counts up
    time_s: float
    t: float
    kind: str  # "set" by a viewer, "state" of the ECU, "vehicle", "bus", "loop"
    text: str


class Events(TypedDict):
    """New ones."""

    type: Literal["events"]
    run: int
    items: list[EventItem]


class SettingsNow(TypedDict):
    """After every change."""

    type: Literal["settings"]
    settings: dict[str, Any]


class LoopNow(TypedDict):
    """What the loop's process does, from the server; first on the channel, also where there is no `hello` yet."""

    type: Literal["loop"]
    state: str  # starting, running, busy (with what takes seconds), ended (for good)
    text: str  # one line for people: what is waited for, or why it ended; empty while it runs


Message = Hello | Periods | Now | BusNow | Events | SettingsNow | LoopNow


Request = dict[str, Any]
"""From a viewer: an `id`, which the answer has, too, and one of `firmware_sim.live.requests.ACTIONS`."""


class Answer(TypedDict, total=False):
    """`error` is one line, and then nothing was changed; `note` reports what was done."""

    id: int
    error: str
    note: str


class FieldPicture(NamedTuple):
    """The flow at the start of period k, time t in t_c. `levels` are (height, width),
    `wake.pictures.levels.field_levels`."""

    k: int
    t: float
    levels: Levels


def pack_field(picture: FieldPicture) -> bytes:
    """Little-endian: k (uint32), t (float32), width, height (uint16), then the levels row by row (int8)."""
    height, width = picture.levels.shape
    return _FIELD.pack(picture.k, picture.t, width, height) + picture.levels.tobytes()
