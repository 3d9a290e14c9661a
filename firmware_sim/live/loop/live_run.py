"""One run of the live loop, from a start of its plant: stepped period by period, disturbed and observed meanwhile."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, cast

from can_bridge.command_gate import Intervention
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Reason
from contract.config.tree import Config
from contract.release.checks import Bundle
from ecu.ecu_state import EcuState
from ecu.stepped import LoopEcu
from firmware_sim.bench.wiring import wire
from firmware_sim.live.loop.bus_table import BusTable
from firmware_sim.live.loop.control_request import ControlRequest
from firmware_sim.live.loop.drag import DragMeans
from firmware_sim.live.loop.messages import FieldPicture
from firmware_sim.live.loop.noticing import BOOT, UNPOWERED, Seen
from firmware_sim.live.loop.switching import LINGER_S, SwitchedDisturbances
from firmware_sim.runs.run_log import Row
from wake.pictures.level_picture import LevelPicture
from wake.plant.protocol import LivePlant, LoopPlant

BOOT_S: Final = 0.2
"""Virtual time from power-on to the ECU's first step: what `reset` takes as its default."""
_FOR_GOOD_NS: Final = 10**18
_AVERAGES_EVERY: Final = 5
"""Periods."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Period:
    """One control period. `planned_ns` is what a step that planned took in virtual time; None without one."""

    k: int
    row: Row
    requested: bool
    planned_ns: int | None


class LiveRun:
    """From the plant's start on. Raises StillwakeError if the plant lacks a sensor of the bundle, or the bus cannot
    carry virtual time.

    Args:
        wake: at the start of a control period.
        lead_in: periods after which control is requested by itself.
        kept: latest periods whose drag is remembered.

    Attributes:
        number, wake, ecu: as given; the ECU may be exchanged.
        k: number of the next period, which lasts `period_ns` in virtual time.
        drag, bus_table: what a viewer sees of them.
        view, raster: of the pictures, their limits in W, and their pixels; empty for a plant whose flow has none.
        picture: the flow at the start of the latest period; None without one.
        latest: period; None before the first.
        state: of the ECU after the latest period.
    """

    def __init__(
        self,
        *,
        number: int,
        bundle: Bundle,
        config: Config,
        wake: LoopPlant,
        ecu: LoopEcu,
        seed: int,
        lead_in: int,
        kept: int,
    ) -> None:
        sensors = bundle.manifest.sensors
        self.number, self.wake, self.ecu = number, wake, ecu
        self._config, self._sensors = config, sensors
        self.request = ControlRequest(lead_in=lead_in, rearm_frames=config.ecu.rearm_frames)
        self.disturbances = SwitchedDisturbances(config, sensors, seed)
        self.drag = DragMeans(config.flow.control_period, kept)
        self.bus_table = BusTable(config, message_set(config.bus))
        self._levels = LevelPicture(cast(LivePlant, wake)) if hasattr(wake, "vorticity") else None
        self.view: Sequence[float] = () if self._levels is None else self._levels.view
        self.raster: Sequence[int] = () if self._levels is None else self._levels.size
        self.picture: FieldPicture | None = None
        self.latest: Period | None = None
        self.is_off = False
        self.wired = wire(wake, sensors, config, ecu, self.disturbances, observe=self.bus_table)
        self._loop, self._bus, self.node = self.wired.loop, self.wired.bus, self.wired.node
        self.k, self.period_ns = 0, config.period_ns
        self.state: EcuState = ecu.ecu.state

    def time_s(self, k: int) -> float:
        """When period k begins, in s of the run."""
        return k * self.period_ns / 1e9

    def step(self) -> Period:
        """One control period. Raises StillwakeError if the flow diverges."""
        k, loop = self.k, self._loop
        requested = self.request.requests(
            k, self.state.fail_safe, is_up=loop.ecu_is_up, given_up=self.node.has_given_up
        )
        if self._levels is not None:
            self.picture = FieldPicture(k=k, t=cast(LivePlant, self.wake).t, levels=self._levels.levels())
        row = loop.period(enable_request=requested)
        self.state = self.ecu.ecu.state
        planned = loop.planned_ns[-1] if loop.planned_ns else None
        loop.planned_ns.clear()
        self.latest = Period(k=k, row=row, requested=requested, planned_ns=planned)
        self.k = k + 1
        self.disturbances.period_over(k)
        self.bus_table.period_over(self._bus.activity())
        without = self.request.first is None or self.request.first == k
        self.drag.add(row.sample)
        if k % _AVERAGES_EVERY == 0 or self.request.first == k:
            self.drag.update(without_control=without)
        return self.latest

    def exchange(self, ecu: LoopEcu) -> None:
        """Go on with another ECU from the state of the one so far."""
        self._loop.exchange_ecu(ecu.ecu, ecu.step_ns)
        self.ecu = ecu

    def help(self) -> bool:
        """End what has latched, or will latch because of earlier faults, by a new request; return whether one is due.

        A sensor that the ECU has set aside is used again when it has started again, which it then does.
        """
        if self.state.sensors.set_aside is not None and not self.is_off:
            self.power_on()
        longest = max(self._config.ecu.loss_window, self._config.vehicle.loss_window)
        self.request.helped_until = self.k + longest + round(LINGER_S * 1e9 / self._config.period_ns)
        return self.request.rearm(self.state.fail_safe, given_up=self.node.has_given_up)

    def power_on(self) -> None:
        """The ECU starts; one that has its supply loses it for a moment."""
        self._reset(round(BOOT_S * 1e9))
        self.is_off = False

    def cut_supply(self) -> None:
        """The ECU is silent until `power_on`. Its CAN transceiver still acknowledges frames."""
        self._reset(_FOR_GOOD_NS)
        self.is_off = True

    def seen(self) -> Seen:
        """As of the latest period."""
        state, mode = self.state, self.state.fail_safe.mode.name
        aside = state.sensors.set_aside
        # An ECU that did not step has a trace of the step before.
        gate = Intervention(0) if self.is_off or not self._loop.ecu_is_up else self.ecu.ecu.trace.interventions
        return Seen(
            state=UNPOWERED if self.is_off else mode if self._loop.ecu_is_up else BOOT,
            reason=Reason(state.fail_safe.reason),
            set_aside=() if aside is None else (self._sensors[aside],),
            given_up=self.node.has_given_up,
            gate=gate,
            nodes={name: port.health().state for name, port in self.wired.ports.items()},
        )

    def set_disturbances(self, texts: tuple[str, ...]) -> None:
        """Have these at work from the next period on. What comes of a new one is its own, and not helped."""
        if self.disturbances.set(texts, self.k):
            self.request.helped_until = 0

    def _reset(self, boot_ns: int) -> None:
        self.request.helped_until = 0
        self._bus.advance_to(self._loop.now_ns)
        self._loop.reset_ecu(boot_ns)
        self.state = self.ecu.ecu.state
