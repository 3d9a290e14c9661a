"""A vehicle in real time: at every sampling instant it sends the pressures, and its jets follow the latest command. The
pressures are from a recording or a live wake. Period k begins at the absolute instant t_k. A frame that arrived before
t_k belongs to period k - 1, even if this process woke late. `VehicleNode` counts periods, as in virtual time."""

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import cycle
from math import ceil, isfinite, nan, sqrt
from typing import Any, Final, Protocol

import numpy as np

from can_bridge.bus.heard import Heard
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import AGE_RESOLUTION_NS
from can_bridge.wire.messages import Mode
from contract.arrays import Array
from contract.config.tree import Config
from contract.errors import BusError, DatasetError
from contract.recording.dataset import Dataset
from contract.sensor_layout import SensorLayout
from ecu.real_time import clock
from ecu.real_time.deadlines import Deadlines
from ecu.real_time.inbox import Inbox
from ecu.real_time.stage_times import NOTHING, StageTimes, VehicleStage
from firmware_sim.bench.vehicle_node import VehicleNode

UNSENT_LIMIT: Final = 50
"""Number of consecutively refused frames at which the bus is considered lost: 50 periods of 20 ms are a second."""
FAREWELL: Final = 3
"""Number of frames that withdraw the request at the end of a run: one more than the losses that the ECU tolerates."""
LONGEST_FAREWELL: Final = 10
"""Largest number of periods for sending the `FAREWELL` frames. No frame is sent if the live wake has no pressures."""
RESOLUTION_NS: Final = 10_000
LARGEST_AGE_NS: Final = 0xFFFF * AGE_RESOLUTION_NS
"""Largest age in ns that a frame can state. After a long pause of this process, older pressures are not sent."""
LONGEST_NS: Final = 2_000_000_000
"""Longest time in ns that `Durations` distinguishes; longer times are counted as this time."""


class Pressures(Protocol):
    """A source of pressures in real time; its `description` states whether the pressures respond to the jets."""

    layout: SensorLayout
    description: str

    def sampled(self) -> Array | None:
        """Return Cp, shape (sensors,), at the present sampling instant; None if the flow has not reached it yet."""

    def drive(self, action: float) -> None:
        """Ramp the jets to `action`, in U_inf W, from this sampling instant to the next."""


class Replay:
    """A replay of recorded pressures, one row per period, which do not respond to the jets. After the last row the
    replay starts from the first row, and the pressures jump. If `episode` is None, the first episode without a
    controller is replayed, preferably one with shut jets. Raises DatasetError if the episode does not exist."""

    def __init__(self, dataset: Dataset, episode: str | None = None) -> None:
        known = {item.name: item for item in dataset.episodes}
        if episode is None:
            chosen = min(known.values(), key=lambda one: (one.role == "controlled", bool(one.series["action"].any())))
        elif episode in known:
            chosen = known[episode]
        else:
            raise DatasetError(f"the data set has no episode {episode!r}, only {', '.join(known)}")
        self.layout, self._rows = dataset.layout, cycle(np.asarray(chosen.series["Cp"], dtype=np.float64))
        self.description = (
            f"open loop: recorded episode {chosen.name}, {len(chosen)} periods; the pressures do not respond to the "
            "jets, and an ECU in control may find them IMPLAUSIBLE or NOT_HELPING"
        )

    def sampled(self) -> Array:
        """Return the recorded row of this period."""
        return next(self._rows)

    def drive(self, action: float) -> None:
        """Ignore the action: a recording does not respond."""


class Durations:
    """A histogram of times in steps of 10 us up to 2 s."""

    def __init__(self) -> None:
        self._counts = np.zeros(LONGEST_NS // RESOLUTION_NS + 1, dtype=np.int64)

    def add(self, duration_ns: int) -> None:
        self._counts[min(max(duration_ns, 0), LONGEST_NS) // RESOLUTION_NS] += 1

    def quantile_ms(self, share: float) -> float:
        """Return the nearest-rank quantile in ms, rounded down to 10 us; NaN if there are no times."""
        up_to = np.cumsum(self._counts)
        if up_to[-1] == 0:
            return nan
        # In floating point, 0.07 * 100 is 7.000000000000001. Without rounding, the rank would be 8 instead of 7.
        rank = max(1, ceil(round(share * int(up_to[-1]), 6)))
        return int(np.searchsorted(up_to, rank)) * RESOLUTION_NS / 1e6


@dataclass(kw_only=True, eq=False)
class VehicleFigures:
    """The counts of one run: started periods; periods left out, because the vehicle was late by at least half a period;
    periods unsampled, because the live wake was late or this process paused; valid commands; periods after the first
    valid command that missed one; commands that acted in the period of their arrival (`at_once`); pressure frames that
    the bus did not accept (`unsent`). `ages` are the times from the sampling of a command's pressures to its arrival,
    `lateness` those from the scheduled instant to the sampling. `squares` is the sum over the `ended` periods of the
    squared action in (U_inf W)^2, `largest` the largest magnitude of an action in U_inf W."""

    periods: int = 0
    left_out: int = 0
    unsampled: int = 0
    commands: int = 0
    misses: int = 0
    at_once: int = 0
    unsent: int = 0
    ages: Durations = field(default_factory=Durations)
    lateness: Durations = field(default_factory=Durations)
    modes: Counter[Mode] = field(default_factory=Counter)
    latest_mode: Mode | None = None
    ended: int = 0
    squares: float = 0.0
    largest: float = 0.0

    @property
    def rms_action(self) -> float:
        """Root mean square of the action over all ended periods, in U_inf W; NaN before the end of the first period."""
        return sqrt(self.squares / self.ended) if self.ended else nan

    def as_dict(self) -> dict[str, Any]:
        """Return the figures for a results file; a figure without measurements is None."""
        counted = ("periods", "left_out", "unsampled", "commands", "misses", "unsent")
        measured = {
            **{name: getattr(self, name) for name in counted},
            "commands_for_their_own_period": self.at_once,
            **{
                f"{name}_{end}_ms": times.quantile_ms(share)
                for name, times in (("age", self.ages), ("lateness", self.lateness))
                for end, share in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))
            },
            "rms_action": self.rms_action,
            "largest_action": self.largest,
        }
        found = {name: value if isfinite(value) else None for name, value in measured.items()}
        return {**found, "modes": {mode.name: count for mode, count in sorted(self.modes.items())}}


class VehicleLoop:
    """The vehicle's loop, which runs periods one by one. `send` sends one frame, and raises BusError if the bus does
    not accept the frame. `now_ns` and `sleep_until` must be functions of the clock of the deadlines and the inbox. The
    caller restarts the counts of received frames, `heard`, by assigning a new `Heard`."""

    def __init__(
        self,
        config: Config,
        node: VehicleNode,
        pressures: Pressures,
        send: Callable[[Frame], None],
        inbox: Inbox,
        deadlines: Deadlines,
        *,
        stage_times: StageTimes | None = None,
        now_ns: Callable[[], int] = clock.now_ns,
        sleep_until: Callable[[int], None] = clock.sleep_until,
    ) -> None:
        self._node, self._pressures, self._send, self._inbox = node, pressures, send, inbox
        self._deadlines, self._stage_times = deadlines, stage_times
        self._now_ns, self._sleep_until = now_ns, sleep_until
        messages = message_set(config.bus)
        self._parse, self._spec = messages.command.parse, messages.command.spec
        self._unsent_in_a_row = self._overslept = 0
        self.figures = VehicleFigures()
        self.heard = Heard()

    def period(self, *, enable_request: bool) -> None:
        """Wait for the next sampling instant and run its period. Raises BusError if the bus is lost (UNSENT_LIMIT)."""
        due_ns = self._next_instant()
        self._end_period(due_ns)
        if self._stage_times is not None:
            self._stage_times.begin()
        self.figures.periods += 1
        self.figures.lateness.add(self._now_ns() - due_ns)
        self._note(VehicleStage.PERIOD, self._deadlines.number)
        self._note(VehicleStage.SCHEDULED, due_ns)
        self._sample(due_ns, enable_request=enable_request, is_noted=True)
        self._deadlines = self._deadlines.after(self._now_ns())

    def finish(self) -> None:
        """Wait for the end of the last period and apply its command; then shut the jets and withdraw the request."""
        due_ns, sent = self._next_instant(), 0
        self._end_period(due_ns)
        for _ in range(LONGEST_FAREWELL):
            sent += self._sample(due_ns, enable_request=False)
            if sent == FAREWELL:
                break
            self._deadlines = self._deadlines.after(self._now_ns())
            due_ns = self._next_instant()

    def _next_instant(self) -> int:
        """Wait for the next sampling instant; skip instants for which this process is half a period or more late."""
        while True:
            due_ns, latest_ns = self._deadlines.due_ns, self._deadlines.period_ns // 2
            self._sleep_until(due_ns)
            if (now_ns := self._now_ns()) - due_ns < latest_ns:
                self.figures.left_out = self._deadlines.left_out + self._overslept
                return due_ns
            self._overslept += 1
            self._deadlines = self._deadlines.after(now_ns)

    def _end_period(self, due_ns: int) -> None:
        """If a period ends now, pass the frames received in it to the jets' driver."""
        if not self.figures.periods:
            return
        frames = self._inbox.before(due_ns)
        self.heard.add(frames)
        actuation = self._node.apply_commands([frame for frame in frames if self._spec.names(frame)])
        figures, action = self.figures, actuation.action
        figures.ended += 1
        figures.squares += action * action
        figures.largest = max(figures.largest, abs(action))
        if actuation.command is None:
            figures.misses += figures.commands > 0
            return
        arrived_ns = actuation.command.timestamp_ns
        command = self._parse(actuation.command.data[: self._spec.protected])
        assert command is not None  # the jets' driver has accepted this frame
        figures.commands += 1
        figures.modes[command.mode] += 1
        figures.latest_mode = command.mode
        figures.at_once += not actuation.next_period
        if actuation.sampled_ns is not None:
            figures.ages.add(arrived_ns - actuation.sampled_ns)
        self._note(VehicleStage.COMMAND_ARRIVED, arrived_ns)
        echoed = NOTHING if command.pressure_counter is None else command.pressure_counter
        self._note(VehicleStage.ECHOED_COUNTER, echoed)
        self._note(VehicleStage.ACTUATED, self._now_ns())

    def _sample(self, due_ns: int, *, enable_request: bool, is_noted: bool = False) -> bool:
        """Send the pressures of this instant; returns whether the bus accepted them."""
        cp = self._pressures.sampled()
        sampled_ns = self._now_ns()
        if cp is None or sampled_ns - due_ns > LARGEST_AGE_NS:
            self.figures.unsampled += is_noted
            return False
        # The frame has the time of the scheduled instant; the age in the frame is the delay of this process.
        age_ns = max(0, sampled_ns - due_ns)
        frame = self._node.sample(cp, enable_request=enable_request, now_ns=due_ns, age_ns=age_ns)
        self._pressures.drive(self._node.foreseen_action)
        try:
            self._send(frame)
            self._unsent_in_a_row = 0
        except BusError as error:
            self.figures.unsent += is_noted
            self._unsent_in_a_row += 1
            if self._unsent_in_a_row >= UNSENT_LIMIT:
                raise BusError(f"{error}; {UNSENT_LIMIT - 1} earlier frames were not sent either") from error
            return False
        if is_noted:
            self._note(VehicleStage.SAMPLED, sampled_ns)
            self._note(VehicleStage.SENT, self._now_ns())
            self._note(VehicleStage.PRESSURE_COUNTER, self._node.counter_of(frame))
        age_ns = max(0, self._now_ns() - due_ns)
        speed = self._node.speed_frame(now_ns=due_ns, age_ns=age_ns) if age_ns <= LARGEST_AGE_NS else None
        if speed is not None:
            with suppress(BusError):  # only refused Pressure frames are counted
                self._send(speed)
        return True

    def _note(self, stage: VehicleStage, value: int) -> None:
        if self._stage_times is not None:
            self._stage_times.note(stage, value)
