"""A vehicle in real time: at every sampling instant it sends the pressures, and its jets follow the latest command.

Period k begins at the absolute instant t_k. A frame that arrived before t_k belongs to period k - 1, even if this
process woke late. The jets' driver, `VehicleNode`, makes the same checks as in virtual time, because the checks count
periods.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Final

import numpy as np

from can_bridge.bus.heard import Heard
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from contract.config.tree import Config
from contract.errors import BusError
from ecu.real_time import clock
from ecu.real_time.deadlines import Deadlines
from ecu.real_time.inbox import Inbox
from ecu.real_time.stage_times import NOTHING, StageTimes, VehicleStage
from firmware_sim.bench.real_time.pressures import Pressures
from firmware_sim.bench.real_time.vehicle_counts import VehicleFigures
from firmware_sim.bench.vehicle_node import VehicleNode

UNSENT_LIMIT: Final = 50
"""Number of consecutively refused frames at which the bus is considered lost: 50 periods of 20 ms are a second."""
FAREWELL: Final = 3
"""Number of frames without a request at the end of a run: one more than the number of losses that the ECU tolerates."""
LONGEST_FAREWELL: Final = 10
"""Largest number of periods in which these frames are sent. In some periods the live wake may have no pressures."""


class VehicleLoop:
    """The vehicle's loop, which runs periods one by one.

    Args:
        send: sends one frame; raises BusError if the bus does not accept the frame.
        now_ns, sleep_until: functions of the clock, which must be the clock of the deadlines and the inbox.

    Attributes:
        heard: counts of the frames received since the caller last set this attribute.
    """

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
        """Wait for the next sampling instant and run its period. Raises BusError after UNSENT_LIMIT refused frames in a
        row; PlantError if the live wake failed."""
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
        """Wait for the next sampling instant, and skip each instant for which this process is half a period late."""
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
        if cp is None:
            self.figures.unsampled += is_noted
            return False
        sampled_ns = self._now_ns()
        # The pressures belong to the scheduled instant, so the age that the frame states is the delay of this process.
        frame = self._node.sample(
            np.asarray(cp), enable_request=enable_request, now_ns=due_ns, age_ns=max(0, sampled_ns - due_ns)
        )
        self._pressures.drive(self._node.foreseen_action)
        try:
            self._send(frame)
            self._unsent_in_a_row = 0
        except BusError as error:
            self.figures.unsent += is_noted
            self._unsent_in_a_row += 1
            if self._unsent_in_a_row >= UNSENT_LIMIT:
                raise BusError(f"{error}; nor were the {UNSENT_LIMIT - 1} before it") from error
            return False
        if is_noted:
            self._note(VehicleStage.SAMPLED, sampled_ns)
            self._note(VehicleStage.SENT, self._now_ns())
            self._note(VehicleStage.PRESSURE_COUNTER, self._node.counter_of(frame))
        speed = self._node.speed_frame(now_ns=due_ns, age_ns=max(0, self._now_ns() - due_ns))
        if speed is not None:
            with suppress(BusError):  # frames that the bus refuses are counted for pressures only
                self._send(speed)
        return True

    def _note(self, stage: VehicleStage, value: int) -> None:
        if self._stage_times is not None:
            self._stage_times.note(stage, value)
