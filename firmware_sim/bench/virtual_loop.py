"""The closed loop in virtual time, deterministic bit for bit: the flow, the bus and the ECU advance together.

The control period that starts at t_k has these events:

    t_k                          the vehicle samples pressures and speed and gives them to its CAN controller
    + wait + frame time          the ECU receives the pressures and steps
    + compute time               the ECU sends the command (`ecu.compute_time_ms`, or an emulated core's time)
    + wait + frame time          the jets' driver receives the command and starts a ramp that ends at t_{k+1}

The simulated bus determines waits and frame times (`can_bridge.bus.simulated`). The jets keep their action until the
command arrives; the time of arrival is rounded up to a time step of the flow. A command that arrives at t_{k+1} or
later acts in the period of its arrival. An ECU that is still computing when its next step is due skips that step. The
compute time is a setting, or comes from the pipeline model of an emulated core; neither depends on the machine. The
step's wall-clock time is measured separately.

The ECU steps when a pressure frame arrives. If no frame arrives within half a period (or one frame time, if that is
longer), the ECU steps without pressures. Its fail-safe counts a miss, and its command still acts in the period. A frame
that arrives later stays in the ECU's queue for the next step. The jets' driver counts a missing command as a miss.
"""

import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import ClassVar

from can_bridge.bus.interface import Bus, BusHealth
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import worst_case_ns
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import MessageSpec
from contract.config.tree import Config
from contract.errors import BusError
from contract.runtime.copies import NeverCopied
from ecu.stepped import LoopEcu
from firmware_sim.bench.vehicle_node import Actuation, VehicleNode
from firmware_sim.runs.run_log import BusTotals, Row
from wake.plant.protocol import Plant
from wake.plant.sample import Sample


def _send(port: Bus, frame: Frame) -> None:
    with suppress(BusError):  # A frame that the bus does not accept is lost; the receiver must detect this.
        port.send(frame)


def check_bit_rates(config: Config) -> None:
    """Raise BusError if a pressure frame takes a whole control period or longer."""
    if (takes_ns := _pressure_frame_ns(config)) >= config.period_ns:
        times = f"{takes_ns / 1e6:g} ms, but a control period only {config.period_ns / 1e6:g} ms"
        raise BusError(f"a pressure frame takes {times}: raise bus.nominal_bitrate or bus.data_bitrate")


def _pressure_frame_ns(config: Config) -> int:
    spec, bus = message_set(config.bus).pressure.spec, config.bus
    frame = Frame(frame_id=spec.frame_id, data=bytes(spec.length), is_fd=spec.is_fd)
    return worst_case_ns(frame, nominal_bitrate=bus.nominal_bitrate, data_bitrate=bus.data_bitrate)


class VirtualLoop(NeverCopied):
    """The closed loop, which runs control periods one by one. A pressure frame must be shorter than a control period
    (`check_bit_rates`). The plant must be at the start of a control period. The bus must be at time 0, and the loop
    advances it; the nodes' ports may have wrappers. `ecu_clock` converts a time of the run to the time on the ECU's
    clock, in ns. `planned_ns` has the computing times in ns of all steps so far in which the controller planned;
    `now_ns` is the start of the next period."""

    INSTEAD: ClassVar = "bus and nodes call each other; repeat the run, which gives the same result bit for bit"

    def __init__(
        self,
        plant: Plant,
        node: VehicleNode,
        ecu: LoopEcu,
        bus: SimulatedBus,
        at_vehicle: Bus,
        at_ecu: Bus,
        config: Config,
        *,
        ecu_health: Callable[[], BusHealth],
        ecu_clock: Callable[[int], int],
    ) -> None:
        self._plant, self._node, self._bus = plant, node, bus
        self._at_vehicle, self._at_ecu, self._ecu_health = at_vehicle, at_ecu, ecu_health
        self._ecu_clock = ecu_clock
        self._power_on = ecu.ecu.state
        self._boots = self._booted_ns = self._rejected = 0  # _rejected: frames that the ECU rejected before a reset
        messages = message_set(config.bus)
        self._pressure, self._command = messages.pressure.spec, messages.command.spec
        self._substeps, self._period_ns = config.flow.substeps, config.period_ns
        self._wait_ns = max(config.period_ns // 2, _pressure_frame_ns(config))
        self._compute_ns = round(config.ecu.compute_time_ms * 1e6)
        self._ecu, self._step_ns = ecu.ecu, ecu.step_ns
        self.planned_ns: list[int] = []
        self.now_ns = 0
        self._busy_until_ns = 0
        self._inbox: list[Frame] = []  # frames that the ECU received since its last step
        self._commands_sent = self._arrived = 0
        self._newest = dict[int, bytes]()

    def period(self, *, enable_request: bool) -> Row:
        """Advance one control period and return its row."""
        end_ns = self.now_ns + self._period_ns
        sample = self._plant.sample()
        self._bus.advance_to(self.now_ns)
        _send(self._at_vehicle, self._node.sample(sample.Cp, enable_request=enable_request, now_ns=self.now_ns))
        speed, speed_frame = self._node.speed, self._node.speed_frame(now_ns=self.now_ns)
        if speed_frame is not None:
            _send(self._at_vehicle, speed_frame)
        self._bus.advance_until(self.now_ns + self._wait_ns, self._pressures_came)
        self._pressures_came()
        step_ms = self._step_ecu(self._bus.now_ns)
        # A frame that arrives at the period's end belongs to the next period.
        self._bus.advance_to(end_ns - 1)
        self._pressures_came()
        actuation = self._node.apply_commands(self._received(self._command, self._at_vehicle.receive_all()))
        self._advance_plant(actuation)
        self.now_ns = end_ns
        return self._row(sample, actuation, step_ms, speed)

    def reset_ecu(self, boot_ns: int) -> None:
        """Make the ECU lose its state at the bus's present time and start again after `boot_ns`. Until then it receives
        nothing. Freshness values (in non-volatile memory) and the CAN controller's counts are kept."""
        state = self._ecu.state
        speed = replace(self._power_on.speed, verifier=state.speed.verifier)
        fresh = replace(self._power_on, verifier=state.verifier, speed=speed, freshness=state.freshness)
        self._ecu.restore(replace(fresh, health=state.health))
        self._rejected += state.frames_rejected - self._ecu.state.frames_rejected
        self._pressures_came()
        self._newest.clear()
        self._inbox, self._boots, self._busy_until_ns = [], self._boots + 1, 0
        self._booted_ns = self._bus.now_ns + boot_ns

    @property
    def ecu_is_up(self) -> bool:
        return self._bus.now_ns >= self._booted_ns

    def exchange_ecu(self, ecu: LoopEcu) -> None:
        """Replace the ECU by an ECU of the same bundle and settings, which continues from the old ECU's state."""
        ecu.ecu.restore(self._ecu.state)
        self._ecu, self._step_ns = ecu.ecu, ecu.step_ns

    def totals(self) -> BusTotals:
        """Return the frame counts so far; a frame that is still being transmitted does not count as lost."""
        sent = self._node.frames_sent + self._commands_sent
        rejected = self._rejected + self._ecu.state.frames_rejected + self._node.frames_rejected
        under_way = sum(self._bus.under_way(spec.frame_id) for spec in (self._pressure, self._command))
        return BusTotals(sent=sent, lost=max(sent - self._arrived - under_way, 0), rejected=rejected)

    def _received(self, message: MessageSpec, frames: list[Frame]) -> list[Frame]:
        """Return and count the frames of a message. Copies, caused by a fault or by an error in a frame's last bit, are
        not counted: a copy has the same bytes as the frame before it, while a new frame has another counter."""
        found = [frame for frame in frames if message.names(frame)]
        for frame in found:
            self._arrived += frame.data != self._newest.get(message.frame_id)
            self._newest[message.frame_id] = frame.data
        return found

    def _pressures_came(self) -> bool:
        """Put received frames into the ECU's inbox, unless it is booting; return whether they include pressures."""
        received = self._at_ecu.receive_all()
        if not self.ecu_is_up:
            return False
        self._inbox += received
        return bool(self._received(self._pressure, received))

    def _step_ecu(self, now_ns: int) -> float:
        """Step the ECU unless it is booting or computing; return the step's wall-clock time in ms, else NaN."""
        if now_ns < max(self._busy_until_ns, self._booted_ns):
            return math.nan
        began = time.perf_counter()
        answers = self._ecu.step(self._ecu_clock(now_ns), self._inbox, self._ecu_health())
        elapsed = time.perf_counter() - began
        self._inbox = []
        takes_ns = self._compute_ns if self._step_ns is None else self._step_ns()
        if self._ecu.trace.forces is not None:
            self.planned_ns.append(takes_ns)
        self._busy_until_ns = now_ns + takes_ns
        self._bus.call_at(self._busy_until_ns, partial(self._answer, answers, self._boots))
        return elapsed * 1e3

    def _answer(self, frames: Sequence[Frame], boots: int) -> None:
        """Send the ECU's frames, unless the ECU was reset after the step that computed them."""
        if boots != self._boots:
            return
        for frame in frames:
            self._commands_sent += self._command.names(frame)
            _send(self._at_ecu, frame)

    def _advance_plant(self, actuation: Actuation) -> None:
        if actuation.command is not None and not actuation.next_period:
            after_ns = actuation.command.timestamp_ns - self.now_ns
            # The ramp to the new action needs at least one time step.
            late = min(self._substeps - 1, math.ceil(after_ns * self._substeps / self._period_ns))
            if late > 0:
                self._plant.advance_to(late)
        self._plant.advance_to(self._substeps, actuation.action)

    def _row(self, sample: Sample, actuation: Actuation, step_ms: float, speed: float) -> Row:
        trace, skipped = self._ecu.trace, math.isnan(step_ms)
        forecast = (math.nan, math.nan) if skipped or trace.forces is None else trace.forces[0]
        age_ms = math.nan
        if actuation.command is not None and actuation.sampled_ns is not None:
            age_ms = (actuation.command.timestamp_ns - actuation.sampled_ns) / 1e6
        return Row(
            sample=sample,
            command=math.nan if skipped else trace.action,
            predicted_Cd=float(forecast[0]),
            predicted_Cl=float(forecast[1]),
            mode=int(trace.mode),
            reason=int(self._ecu.state.fail_safe.reason),
            step_ms=step_ms,
            age_ms=age_ms,
            set_aside=self._ecu.state.sensors.mask,
            speed=speed,
        )
