"""Tables of stage times made by hand: every stage takes a known time, and faults are planted."""

from dataclasses import dataclass, field

import numpy as np

from ecu.real_time.stage_times import NOTHING, EcuStage, VehicleStage
from firmware_sim.latency.idle_loop import IdleStage
from firmware_sim.latency.stages import Periods, Times, joined

MS = 1_000_000
PERIOD = 20 * MS
START = 7_000 * MS
COUNTERS = 256
IN_VEHICLE = [VehicleStage.PRESSURE_COUNTER, VehicleStage.ECHOED_COUNTER]
ON_ECU = {"bus_to_ecu": 0.5, "wait": 3.2, "receive": 0.25, "plan": 8.0, "gate": 0.125}
TOOK = {"sample": 0.3, **ON_ECU, "bus_to_vehicle": 0.4}
"""ms of each stage where nothing is planted; the sums are of whole nanoseconds."""


@dataclass
class Tables:
    count: int
    first_counter: int = 250
    vehicle: Times = field(init=False)
    ecu: Times = field(init=False)
    idle: Times = field(init=False)

    def __post_init__(self) -> None:
        ns = {name: round(ms * MS) for name, ms in TOOK.items()}
        self.vehicle = np.zeros((self.count, len(VehicleStage)), dtype=np.int64)
        self.ecu = np.zeros((self.count, len(EcuStage)), dtype=np.int64)
        self.idle = np.zeros((self.count, len(IdleStage)), dtype=np.int64)
        for i in range(self.count):
            scheduled = START + i * PERIOD
            sampled, arrived, due, plan, planned, stepped, command = (scheduled + np.cumsum(list(ns.values()))).tolist()
            counter = (self.first_counter + i) % COUNTERS
            # The vehicle's numbers begin at 100, the ECU's periods at 3: only the frames' counters connect them.
            self.vehicle[i] = (100 + i, scheduled, sampled, arrived, counter, command, counter, scheduled + PERIOD)
            self.ecu[i, : EcuStage.SENT + 1] = (
                *(3 + i, due, due + 50_000, counter, arrived, due + 60_000),
                *(plan, planned, stepped, command),
            )
            self.idle[i] = (i, scheduled + 5 * MS, scheduled + 5 * MS + 80_000)

    def join(self) -> Periods:
        return joined(self.vehicle, self.ecu, period_ns=PERIOD, counter_period=COUNTERS)

    def later(self, i: int, stage: EcuStage, ms: float) -> None:
        """Delay in the ECU's step i, from that stage on, with its command."""
        ns = round(ms * MS)
        self.ecu[i, [s for s in range(stage, EcuStage.SENT + 1)]] += ns
        self.vehicle[i, VehicleStage.COMMAND_ARRIVED] += ns

    def lose_command(self, i: int | slice) -> None:
        self.vehicle[i, [VehicleStage.COMMAND_ARRIVED, VehicleStage.ECHOED_COUNTER]] = (0, NOTHING)

    def lose_frame(self, i: int) -> None:
        """The ECU steps without it, and answers by the frame before."""
        self.ecu[i, [EcuStage.PRESSURE_COUNTER, EcuStage.FRAME_ARRIVED]] = (NOTHING, 0)
        self.ecu[i, [EcuStage.PLAN_BEGAN, EcuStage.PLAN_ENDED]] = 0
        self.vehicle[i, VehicleStage.ECHOED_COUNTER] = self.vehicle[i - 1, VehicleStage.PRESSURE_COUNTER]

    def stall_ecu(self, i: int, periods: int) -> None:
        """The ECU sleeps from step i on; step i + periods takes the newest frame."""
        gone = slice(i, i + periods)
        self.vehicle[gone, VehicleStage.COMMAND_ARRIVED] = 0
        self.vehicle[gone, VehicleStage.ECHOED_COUNTER] = NOTHING
        self.ecu = np.delete(self.ecu, gone, axis=0)

    def stall_vehicle(self, i: int, periods: int) -> None:
        """The vehicle leaves these out; its counter does not move, and the ECU's steps find nothing."""
        for j in range(i, i + periods):
            self.lose_frame(j)
        after = slice(i + periods, None)
        self.vehicle[after, IN_VEHICLE] = (self.vehicle[after, IN_VEHICLE] - periods) % COUNTERS
        self.ecu[after, EcuStage.PRESSURE_COUNTER] = (self.ecu[after, EcuStage.PRESSURE_COUNTER] - periods) % COUNTERS
        self.vehicle = np.delete(self.vehicle, slice(i, i + periods), axis=0)
