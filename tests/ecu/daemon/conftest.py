"""A daemon's loop on a real python-can bus, with a vehicle opposite, in time that the test lets pass."""

import time
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import can
import numpy as np
import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import FD
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE
from contract import sensors
from contract.config.tree import Config
from contract.config.vehicle import BusConfig, EcuConfig
from ecu.daemon.connection import Connection
from ecu.daemon.control_loop import ControlLoop
from ecu.daemon.reception import FrameReception
from ecu.ecu import Ecu
from ecu.real_time.stage_times import EcuStage, StageTimes, TimedController
from tests.ecu.conftest import RecordingController, make_bundle
from tests.ecu.daemon.driving import Vehicle

CHANNELS = count()
START_NS = 10**12


def wait_for(condition: Callable[[], Any]) -> Any:
    begin = time.monotonic()
    while not (value := condition()):
        assert time.monotonic() - begin < 10.0, "it did not happen"
        time.sleep(0.001)
    return value


class Rig:
    """The loop, and a vehicle that samples at phase + k periods.

    Time stands still but in the loop's sleep, in which the vehicle does what is due, and where `controller` spends
    some. Frames go over a `virtual` bus of python-can and through the thread that reads it; the rig waits until they
    have arrived.
    """

    def __init__(self, bundle, controller, *, phase_ns: int = 3_000_000, **ecu_settings) -> None:
        self.config = Config(ecu=EcuConfig(**ecu_settings))
        self.bus_config = BusConfig(interface="virtual", channel=f"daemon-{next(CHANNELS)}")
        self.period_ns = self.config.period_ns
        self.now, self.next_sample = START_NS, START_NS + phase_ns
        self.vehicle_bus = PythonCanBus.open(self.bus_config)
        self.vehicle = Vehicle(self.config, self.vehicle_bus)
        self.controller = controller
        self.timed = TimedController(controller, lambda: self.now)
        self.ecu = Ecu(bundle, self.timed, self.config)
        self.inbox = FrameReception(messages=FD, interface="virtual", monotonic_ns=lambda: self.now)
        self.opened: list[can.BusABC] = []
        self.connection = Connection(self.open_bus, self.inbox.put, first_pause_s=0.01)
        self.connection.__enter__()
        self.stages = StageTimes(EcuStage, 1000)
        self.events: list[str] = []
        self.loop = ControlLoop(
            self.ecu,
            self.timed.times,
            self.connection,
            self.inbox,
            self.config,
            tell=lambda event, line, **fields: self.events.append(event),
            stage_times=self.stages,
            now_ns=lambda: self.now,
            sleep_until=self.sleep_until,
        )
        self.request, self.samples = True, 0
        self.delay = lambda number: 0
        self.pending: list[tuple[int, Frame | None]] = []
        self.commands, self.statuses = self.vehicle.commands, self.vehicle.statuses
        self.actions: list[float] = []

    def open_bus(self) -> PythonCanBus:
        backend = can.Bus(interface="virtual", channel=self.bus_config.channel, protocol=can.CanProtocol.CAN_FD)
        self.opened.append(backend)
        return PythonCanBus(backend, accept={PRESSURE.frame_id, JET_COMMAND.frame_id})

    def sleep_until(self, due_ns: int) -> None:
        while (first := min([(self.next_sample, None), *self.pending], key=lambda item: item[0]))[0] <= due_ns:
            at, frame = first
            self.now = max(self.now, at)
            if frame is None:
                self._sample()
            else:
                self.pending.remove(first)
                self._send(frame)
        self.now = max(self.now, due_ns)

    def _sample(self) -> None:
        self.actions.append(self.vehicle.hear())
        # The request is raised in the second frame of all: one that stands at power-on is none.
        cp = np.full(sensors.COUNT, 0.1)
        frame = self.vehicle.node.sample(cp, enable_request=self.request and self.samples > 0, now_ns=self.now)
        late_ns = self.delay(self.samples)
        self.samples += 1
        self.next_sample += self.period_ns
        if late_ns == 0:
            self._send(frame)
        elif late_ns is not None:
            self.pending.append((self.now + late_ns, frame))

    def _send(self, frame) -> None:
        before = self.inbox.received
        self.vehicle_bus.send(frame)
        if self.hears:
            wait_for(lambda: self.inbox.received > before)

    @property
    def hears(self) -> bool:
        read = self.connection._bus
        return read is not None and read.fault is None

    def run(self, steps: int) -> None:
        """So many more control steps; what they sent is then in `commands` and `statuses`."""
        self.loop.run(lambda: False, self.loop.counters.steps + steps)
        self.actions.append(self.vehicle.hear())

    def into_control(self) -> None:
        self.run(30)
        assert self.statuses[-1].state.name == "CONTROL", self.statuses[-1]
        assert self.actions[-1] != 0.0

    def column(self, stage: EcuStage) -> list[int]:
        return self.stages.rows()[:, stage].tolist()

    def close(self) -> None:
        self.connection.__exit__(None, None, None)
        self.vehicle_bus.close()


@pytest.fixture
def rig_of() -> Iterator[Callable[..., Rig]]:
    rigs: list[Rig] = []

    def make(controller=None, **settings) -> Rig:
        rigs.append(Rig(make_bundle(), controller or RecordingController(), **settings))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()


@pytest.fixture
def rig(rig_of) -> Rig:
    return rig_of()
