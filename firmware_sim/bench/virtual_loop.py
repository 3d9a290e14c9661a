"""The closed loop in virtual time: flow, bus and ECU advance together, deterministic to the bit.

Every frame travels a python-can bus, stamped with virtual time. In the period that starts at t_k

    t_k                          the vehicle samples the pressures and sends them
    + frame time                 the ECU has them and steps
    + compute time               the command goes out (`ecu.compute_time_ms`: a stated budget, see below)
    + frame time                 the jets' driver has it and starts its ramp, which ends at t_{k+1}

The plant is held at the command's arrival, rounded up to a time step of the flow, with the jets as they were: late
commands act late. An answer that arrives after t_{k+1} acts in the period it arrives in, and an ECU still computing
when its next step is due skips that step. Frame times are worst cases with an idle bus otherwise. Virtual compute
time is a setting, so that a run does not depend on the machine; the step's wall-clock time is measured beside it.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from can_bridge.bus.interface import Bus
from can_bridge.wire.bit_timing import worst_case_ns
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE
from contract import sensors
from contract.config.tree import Config
from firmware_sim.bench.vehicle_node import PressureNode
from firmware_sim.ecu.ecu import Ecu
from firmware_sim.runs.run_log import BusTotals, Row
from wake.plant import Plant
from wake.truck.sample import Sample


@dataclass(frozen=True, kw_only=True, eq=False)
class Wires:
    """The three places where frames enter and leave one bus."""

    vehicle: Bus
    ecu: Bus
    monitor: Bus


class VirtualLoop:
    """Runs periods one by one.

    Args:
        plant: the flow, at the start of a control period.
        node: the vehicle's side.
        ecu: the controller.
        wires: their connections to one bus; the monitor hears everything.
        capture: called with every frame on the bus, in the order of virtual time.
        config: clock, bit rates, compute time.
        clock: wall clock in s for the step's measured time; reads nothing that the loop depends on.
    """

    def __init__(
        self,
        plant: Plant,
        node: PressureNode,
        ecu: Ecu,
        wires: Wires,
        config: Config,
        capture: Callable[[Frame], None],
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._plant = plant
        self._node = node
        self._ecu = ecu
        self._wires = wires
        self._config = config
        self._capture = capture
        self._clock = clock
        self._period_ns = config.period_ns
        self._compute_ns = round(config.ecu.compute_time_ms * 1e6)
        self._start_ns = 0
        self._busy_until_ns = 0
        self._inbox: list[Frame] = []  # what the ECU has heard since its last step
        self._outbox: list[Frame] = []  # what it will send when its computing is done
        self._in_flight: list[Frame] = []  # jet commands on their way to the driver
        self._commands_sent = 0
        self._commands_received = 0
        self._pressures_received = 0

    def period(self, *, enable_request: bool) -> Row:
        """Advance one control period and return what it was like at its start."""
        start = self._start_ns
        sample = self._plant.sample()
        step_ms = self._exchange(sample, enable_request)
        end = start + self._period_ns
        arrived = [frame for frame in self._in_flight if self._arrival_ns(frame) < end]
        self._in_flight = [frame for frame in self._in_flight if self._arrival_ns(frame) >= end]
        self._commands_received += len(arrived)
        driven = self._node.drive(arrived)
        substeps = self._config.flow.substeps
        if driven.command is not None:
            after_ns = self._arrival_ns(driven.command) - start
            late = min(substeps - 1, math.ceil(after_ns * substeps / self._period_ns))
            if late > 0:
                self._plant.advance_to(late)
        self._plant.advance_to(substeps, driven.action)
        self._start_ns += self._period_ns
        trace, skipped = self._ecu.trace, math.isnan(step_ms)
        forecast = (math.nan, math.nan) if skipped or trace.forces is None else trace.forces[0]
        age_ms = math.nan
        if driven.command is not None and driven.sampled_ns is not None:
            age_ms = (self._arrival_ns(driven.command) - driven.sampled_ns) / 1e6
        return Row(
            t=sample.t,
            Cd=sample.Cd,
            Cl=sample.Cl,
            Cd_slot_pressure=sample.Cd_slot_pressure,
            Cd_slot_viscous=sample.Cd_slot_viscous,
            Cd_momentum=sample.Cd_momentum,
            jet_power=sample.jet_power,
            Uy_probe=sample.Uy_probe,
            base_Cp=float(np.mean(sample.Cp[sensors.BASE])),
            action=sample.action,
            command=math.nan if skipped else trace.action,
            predicted_Cd=float(forecast[0]),
            predicted_Cl=float(forecast[1]),
            mode=int(trace.mode),
            step_ms=step_ms,
            age_ms=age_ms,
        )

    def totals(self) -> BusTotals:
        """Frames so far; a command still under way is not lost."""
        sent = self._node.frames_sent + self._commands_sent
        received = self._pressures_received + self._commands_received + len(self._in_flight)
        rejected = self._ecu.frames_rejected + self._node.frames_rejected
        return BusTotals(sent=sent, lost=sent - received, rejected=rejected)

    def _exchange(self, sample: Sample, enable_request: bool) -> float:
        """One period's frames, in the order of virtual time; the wall-clock ms of the ECU's step, NaN if skipped."""
        frame = self._node.sample(sample.Cp, enable_request=enable_request, now_ns=self._start_ns)
        self._wires.vehicle.send(frame)
        heard = self._arrival_ns(frame)
        received = self._wires.ecu.receive_all()
        self._pressures_received += sum(item.frame_id == PRESSURE.frame_id for item in received)
        self._inbox += received
        step_ms = math.nan
        if heard >= self._busy_until_ns:
            step_ms = self._step(heard)
        self._send_due()
        self._in_flight += [item for item in self._wires.vehicle.receive_all() if item.frame_id == JET_COMMAND.frame_id]
        for item in self._wires.monitor.receive_all():
            self._capture(item)
        return step_ms

    def _step(self, now_ns: int) -> float:
        """One step of the ECU on all it has heard; returns its wall-clock ms."""
        received, self._inbox = self._inbox, []
        began = self._clock()
        answers = self._ecu.step(now_ns, received)
        elapsed = self._clock() - began
        self._busy_until_ns = sent = now_ns + self._compute_ns
        for answer in answers:
            self._outbox.append(replace(answer, timestamp_ns=sent))
            sent = self._arrival_ns(self._outbox[-1])
        return elapsed * 1e3

    def _send_due(self) -> None:
        """Put on the bus what the ECU sends before the next pressures; later answers must not overtake those."""
        end = self._start_ns + self._period_ns
        due = [frame for frame in self._outbox if frame.timestamp_ns < end]
        self._outbox = [frame for frame in self._outbox if frame.timestamp_ns >= end]
        for frame in due:
            self._wires.ecu.send(frame)
        self._commands_sent += sum(frame.frame_id == JET_COMMAND.frame_id for frame in due)

    def _arrival_ns(self, frame: Frame) -> int:
        """When a frame that was sent at its timestamp is there."""
        bus = self._config.bus
        return frame.timestamp_ns + worst_case_ns(
            frame, nominal_bitrate=bus.nominal_bitrate, data_bitrate=bus.data_bitrate
        )
