"""A run of the live loop. It starts in the plant's initial state and is computed period by period."""

import struct
from collections import deque
from dataclasses import dataclass
from typing import Final, cast

import numpy as np

from can_bridge.command_gate import Intervention
from can_bridge.secoc.securing import authentication_in_virtual_time
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Reason
from contract.config.tree import Config
from contract.errors import PlantError
from contract.release.checks import Bundle
from ecu.ecu_state import EcuState
from ecu.fail_safe import FailSafe, OperatingMode
from ecu.stepped import LoopEcu
from firmware_sim.bench.simulation import SHEDDING_TIME, wire
from firmware_sim.live.loop.bus_table import BusTable
from firmware_sim.live.loop.messages import KEPT_PERIODS
from firmware_sim.live.loop.noticing import BOOT, UNPOWERED, SeenState
from firmware_sim.live.loop.switching import LINGER_S, SwitchedDisturbances
from firmware_sim.runs.run_log import Row
from wake.pictures.fields import LevelPicture, Levels
from wake.plant.protocol import LivePlant, LoopPlant
from wake.plant.sample import Sample
from wake.truck.averages import over_cycles, over_last_cycles

_NEEDS_A_RISE = (OperatingMode.INIT, OperatingMode.STANDBY, OperatingMode.FAULT)  # left only when the request rises
BOOT_S: Final = 0.2
"""Virtual time in s from power-on to the ECU's first step; it equals the default of the disturbance `reset`."""
_FOR_GOOD_NS: Final = 10**18
_AVERAGES_EVERY: Final = 5


@dataclass(kw_only=True)
class ControlRequest:
    """The request for control in one run of the loop. It begins after `lead_in` periods (while `waits`), unless a
    viewer sets it earlier. The ECU needs `rearm_frames` consecutive good frames before a request clears a latched
    fault. With `rearming`, the request stays low until the ECU will accept a high request. Before the period
    `helped_until`, a new request clears latched faults automatically. `first` is the period of the first request."""

    lead_in: int
    rearm_frames: int
    wanted: bool = False
    waits: bool = True
    rearming: bool = False
    helped_until: int = 0
    first: int | None = None

    def set(self, wanted: bool) -> None:
        """Set whether a viewer wants control; this ends the lead-in."""
        self.wanted, self.waits, self.rearming = wanted, False, False

    def rearm(self, fail_safe: FailSafe, *, given_up: bool) -> bool:
        """Withdraw the request if control can start only with a new request; return whether it is withdrawn now."""
        latched = given_up or fail_safe.mode in _NEEDS_A_RISE
        self.rearming = self.rearming or (self.first is not None and self.wanted and latched)
        return self.rearming

    def begins(self, k: int) -> bool:
        """If period k is the first after the lead-in, request control; return whether this call requested it."""
        if not (self.waits and k >= self.lead_in):
            return False
        self.wanted, self.waits = True, False
        return True

    def requests(self, k: int, fail_safe: FailSafe, *, is_up: bool, given_up: bool) -> bool:
        """Return whether control is requested in period k. `fail_safe`: the ECU's state after the previous period.
        `is_up`: the ECU has booted. `given_up`: the vehicle has given up control and not yet withdrawn its request."""
        if self.rearming and is_up and not given_up and self._may_rise(fail_safe):
            self.rearming = False
        elif k < self.helped_until:
            self.rearm(fail_safe, given_up=given_up)
        requested = self.wanted and not self.rearming
        if requested and self.first is None:
            self.first = k
        return requested

    def _may_rise(self, fail_safe: FailSafe) -> bool:
        """Return whether the ECU has received a low request and will accept a high request."""
        if fail_safe.enable_request:
            return False
        if fail_safe.mode is OperatingMode.FAULT:
            # The frame with the first high request also counts as a good frame.
            return fail_safe.good + 1 >= self.rearm_frames
        return fail_safe.mode is OperatingMode.ARMED


class DragMeans:
    """The mean drag in one run of the loop, from its latest samples, which are `control_period` (in t_c) apart, over
    the shedding cycles before the first request, and over the latest cycle (`now`); None without a whole cycle."""

    def __init__(self, control_period: float) -> None:
        self._period = control_period
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=KEPT_PERIODS)
        self._frequency = 1.0 / SHEDDING_TIME
        self.uncontrolled: float | None = None
        self.now: float | None = None

    def add(self, sample: Sample) -> None:
        self._samples.append((sample.t, sample.Cd, sample.Cl))

    def update(self, *, without_control: bool) -> None:
        """Update `now` and, if all stored samples are without control (`without_control`), also `uncontrolled`."""
        if without_control:
            t, drag, lift = np.array(self._samples, dtype=float).T
            try:
                average = over_cycles(t, lift)
            except PlantError:
                self.uncontrolled = None
            else:
                self.uncontrolled, self._frequency = float(average.mean(drag)), average.frequency
        needed = int(1.0 / (self._frequency * self._period)) + 3
        latest = np.array([self._samples[at] for at in range(-min(needed, len(self._samples)), 0)], dtype=float)
        try:
            # These samples span less than two shedding cycles, so the average is over one cycle.
            self.now = float(over_last_cycles(latest[:, 0], self._frequency).mean(latest[:, 1]))
        except PlantError:
            self.now = None

    @property
    def reduction_percent(self) -> float | None:
        """Reduction of the mean drag by control, in percent; None if a mean is missing."""
        if self.uncontrolled is None or self.now is None:
            return None
        return 100.0 * (1.0 - self.now / self.uncontrolled)


def pack_field(k: int, t: float, levels: Levels) -> bytes:
    """Pack the flow at the start of period k as little-endian bytes: k (uint32), the time t in t_c (float32), width and
    height (uint16), then rows of levels (int8). `wake.pictures.fields` explains the levels."""
    height, width = levels.shape
    return struct.pack("<IfHH", k, t, width, height) + levels.tobytes()


@dataclass(frozen=True, kw_only=True, eq=False)
class LivePeriod:
    """A control period; `is_planned` is whether the ECU's step had a plan."""

    k: int
    row: Row
    requested: bool
    is_planned: bool


class LiveRun:
    """A run from the plant's initial state. Without a viewer's action, control is requested after `lead_in` periods.
    The next period has the number `k`. `levels` makes the pictures, and `picture` is the packed flow at the start of
    the latest period; both are None for a plant without a flow field. `state` is the ECU's state after the latest
    period. Raises StillwakeError if the plant lacks a sensor, or the bus does not work in virtual time."""

    def __init__(
        self, number: int, bundle: Bundle, config: Config, wake: LoopPlant, ecu: LoopEcu, *, lead_in: int
    ) -> None:
        sensors = bundle.manifest.sensors
        self.number, self.wake, self.ecu = number, wake, ecu
        self._config, self._sensors = config, sensors
        self.request = ControlRequest(lead_in=lead_in, rearm_frames=config.ecu.rearm_frames)
        self.disturbances = SwitchedDisturbances(config, sensors)
        self.drag = DragMeans(config.flow.control_period)
        self.bus_table = BusTable(config, message_set(config.bus))
        self.levels = LevelPicture(cast(LivePlant, wake)) if hasattr(wake, "vorticity") else None
        self.picture: bytes | None = None
        self.latest: LivePeriod | None = None
        self.is_off = False
        authentication = authentication_in_virtual_time(config.bus)
        self.wired = wire(wake, sensors, config, ecu, self.disturbances, authentication, observe=self.bus_table)
        self._loop, self._bus, self.node = self.wired.loop, self.wired.bus, self.wired.node
        self.k, self.period_ns = 0, config.period_ns
        self.state: EcuState = ecu.ecu.state

    def time_s(self, k: int) -> float:
        """Return the time at the start of period k, in s from the start of the run."""
        return k * self.period_ns / 1e9

    def step(self) -> LivePeriod:
        """Run one control period. Raises StillwakeError if the flow diverges."""
        k, loop = self.k, self._loop
        before, given_up = self.state.fail_safe, self.node.has_given_up
        requested = self.request.requests(k, before, is_up=loop.ecu_is_up, given_up=given_up)
        if self.levels is not None:
            self.picture = pack_field(k, cast(LivePlant, self.wake).t, self.levels.levels())
        row = loop.period(enable_request=requested)
        self.state = self.ecu.ecu.state
        self.latest = LivePeriod(k=k, row=row, requested=requested, is_planned=bool(loop.planned_ns))
        loop.planned_ns.clear()
        self.k = k + 1
        self.disturbances.period_over(k)
        self.bus_table.period_over(self._bus.activity())
        without = self.request.first is None or self.request.first == k
        self.drag.add(row.sample)
        if k % _AVERAGES_EVERY == 0 or self.request.first == k:
            self.drag.update(without_control=without)
        return self.latest

    def exchange(self, ecu: LoopEcu) -> None:
        """Replace the present ECU by another ECU, which continues from the present ECU's state."""
        self._loop.exchange_ecu(ecu)
        self.ecu = ecu

    def help(self) -> bool:
        """Clear latched faults with a new request for control, also in the next periods, in which earlier disturbances
        may still latch faults. Restart an ECU that has excluded a sensor. Return whether the request is withdrawn."""
        if self.state.sensors.set_aside is not None and not self.is_off:
            self.power_on()
        longest = max(self._config.ecu.loss_window, self._config.vehicle.loss_window)
        self.request.helped_until = self.k + longest + round(LINGER_S * 1e9 / self._config.period_ns)
        return self.request.rearm(self.state.fail_safe, given_up=self.node.has_given_up)

    def power_on(self) -> None:
        """Start the ECU. If it is running, interrupt its supply for a moment, so that it starts again."""
        self._reset(round(BOOT_S * 1e9))
        self.is_off = False

    def cut_supply(self) -> None:
        """Cut the ECU's supply: it sends nothing until `power_on`. Its CAN transceiver still acknowledges frames."""
        self._reset(_FOR_GOOD_NS)
        self.is_off = True

    def seen(self) -> SeenState:
        """Return the state after the latest period."""
        state, mode = self.state, self.state.fail_safe.mode.name
        aside = state.sensors.set_aside
        # An ECU that is off or booting makes no step. Its trace, which is from an earlier step, is ignored.
        gate = Intervention(0) if self.is_off or not self._loop.ecu_is_up else self.ecu.ecu.trace.interventions
        return SeenState(
            state=UNPOWERED if self.is_off else mode if self._loop.ecu_is_up else BOOT,
            reason=Reason(state.fail_safe.reason),
            set_aside=() if aside is None else (self._sensors[aside],),
            given_up=self.node.has_given_up,
            gate=gate,
            nodes={name: port.health().state for name, port in self.wired.ports.items()},
        )

    def set_disturbances(self, texts: tuple[str, ...]) -> None:
        """Apply only these disturbances from the next period on. A new disturbance ends the clearing by `help`."""
        if self.disturbances.set(texts, self.k):
            self.request.helped_until = 0

    def _reset(self, boot_ns: int) -> None:
        self.request.helped_until = 0
        self._bus.advance_to(self._loop.now_ns)
        self._loop.reset_ecu(boot_ns)
        self.state = self.ecu.ecu.state
