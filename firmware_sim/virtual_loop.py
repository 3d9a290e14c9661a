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
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from can_bridge.bit_timing import worst_case_ns
from can_bridge.bus import Bus
from can_bridge.frame import Frame
from can_bridge.message_specs import JET_COMMAND, PRESSURE
from contract import sensors
from contract.config import Config
from firmware_sim.ecu import Ecu
from firmware_sim.run_log import BusTotals, Row
from firmware_sim.vehicle import PressureNode
from wake.truck_wake import Sample


class Plant(Protocol):
    """What the loop needs of a flow."""

    def sample(self) -> Sample:
        """Measure now."""

    def advance_to(self, substep: int, action: float | None = None) -> Sample:
        """Advance within the control period; with an action, ramp so as to reach it at the period's end."""


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
        self._in_flight: list[tuple[int, Frame]] = []  # jet commands, by arrival
        self._commands_sent = 0
        self._commands_received = 0
        self._pressures_received = 0

    def period(self, *, enable_request: bool) -> Row:
        """Advance one control period and return what it was like at its start."""
        start = self._start_ns
        sample = self._plant.sample()
        step_ms = self._exchange(sample, enable_request)
        arrivals = [(at, frame) for at, frame in self._in_flight if at < start + self._period_ns]
        self._in_flight = self._in_flight[len(arrivals) :]
        self._commands_received += len(arrivals)
        action = self._node.drive([frame for _, frame in arrivals])
        substeps = self._config.flow.substeps
        late = min(substeps - 1, math.ceil((arrivals[-1][0] - start) * substeps / self._period_ns)) if arrivals else 0
        if late > 0:
            self._plant.advance_to(late)
        self._plant.advance_to(substeps, action)
        self._start_ns += self._period_ns
        trace = self._ecu.trace
        forecast = (math.nan, math.nan) if trace.forces is None else trace.forces[0]
        return Row(
            **{name: getattr(sample, name) for name in ("t", "Cd", "Cl", "Cd_slot", "Cd_momentum", "jet_power")},
            Uy_probe=sample.Uy_probe,
            base_Cp=float(np.mean(sample.Cp[sensors.BASE])),
            action=sample.action,
            command=trace.action,
            predicted_Cd=float(forecast[0]),
            predicted_Cl=float(forecast[1]),
            mode=int(trace.mode),
            step_ms=step_ms,
            age_ms=(arrivals[-1][0] - start) / 1e6 if arrivals else math.nan,
        )

    def totals(self) -> BusTotals:
        """Frames so far; a command still under way is not lost."""
        sent = self._node.frames_sent + self._commands_sent
        received = self._pressures_received + self._commands_received + len(self._in_flight)
        rejected = self._ecu.frames_rejected + self._node.frames_rejected
        return BusTotals(sent=sent, lost=sent - received, rejected=rejected)

    def _exchange(self, sample: Sample, enable_request: bool) -> float:
        """Pressures to the ECU and its answer onto the bus; the wall-clock ms of its step, NaN if it skipped it."""
        frame = self._node.sample(sample.Cp, enable_request=enable_request, now_ns=self._start_ns)
        self._wires.vehicle.send(frame)
        heard = self._start_ns + self._frame_ns(frame)
        if heard < self._busy_until_ns:
            self._drain()
            return math.nan
        received = self._wires.ecu.receive_all()
        self._pressures_received += sum(item.frame_id == PRESSURE.frame_id for item in received)
        began = self._clock()
        answers = self._ecu.step(heard, received)
        elapsed = self._clock() - began
        self._busy_until_ns = sent = heard + self._compute_ns
        for answer in answers:
            stamped = Frame(frame_id=answer.frame_id, data=answer.data, timestamp_ns=sent, is_fd=answer.is_fd)
            self._wires.ecu.send(stamped)
            sent += self._frame_ns(stamped)
        self._commands_sent += sum(item.frame_id == JET_COMMAND.frame_id for item in answers)
        self._drain()
        return elapsed * 1e3

    def _drain(self) -> None:
        """Collect what the vehicle heard, with its arrival time, and capture what the monitor heard."""
        for frame in self._wires.vehicle.receive_all():
            if frame.frame_id == JET_COMMAND.frame_id:
                self._in_flight.append((frame.timestamp_ns + self._frame_ns(frame), frame))
        for frame in self._wires.monitor.receive_all():
            self._capture(frame)

    def _frame_ns(self, frame: Frame) -> int:
        bus = self._config.bus
        return worst_case_ns(frame, nominal_bitrate=bus.nominal_bitrate, data_bitrate=bus.data_bitrate)
