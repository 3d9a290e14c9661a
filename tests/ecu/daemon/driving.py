"""A vehicle in real time opposite an ECU that runs by itself, in a thread or a process of its own.

It asserts no times: on a machine that is busy with other things control may take long to come, or need another edge.
"""

import time
from collections.abc import Callable

import numpy as np

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.secoc.securing import Authentication
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import EcuStatus, JetCommand
from contract import sensors
from contract.config.tree import Config
from firmware_sim.bench.vehicle_node import VehicleNode
from tests.ecu.conftest import NAMES

PATIENCE_S = 120.0
"""How long a test waits for another process before it fails; never reached when all is well."""


class Vehicle:
    def __init__(self, config: Config, bus: PythonCanBus, authentication: Authentication | None = None) -> None:
        self.node = VehicleNode(NAMES, config, authentication=authentication)
        self._bus, self._period_s, self._messages = bus, config.period_ns / 1e9, message_set(config.bus)
        self._due, self._phase = time.monotonic(), 0
        self.commands: list[JetCommand] = []
        self.statuses: list[EcuStatus] = []
        self.action = self.largest_action = 0.0

    def period(self, *, request: bool) -> None:
        """Wait for it, send pressures, and do what was commanded since the last one."""
        self._due = max(self._due + self._period_s, time.monotonic())
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._phase += 1
        cp = 0.3 * np.sin(0.25 * self._phase + np.arange(sensors.COUNT))
        self._bus.send(self.node.sample(cp, enable_request=request, now_ns=time.monotonic_ns()))
        self.largest_action = max(self.largest_action, abs(self.hear()))

    def hear(self) -> float:
        """Read what came, and do what was commanded: the jets' action."""
        command, status = self._messages.command, self._messages.status
        heard = self._bus.receive_all()
        for frame in heard:
            if command.spec.names(frame) and (said := command.parse(frame.data[: command.spec.protected])):
                self.commands.append(said)
            if status.spec.names(frame) and (told := status.parse(frame.data[: status.spec.protected])):
                self.statuses.append(told)
        self.action = self.node.apply_commands([frame for frame in heard if command.spec.names(frame)]).action
        return self.action

    def until(self, condition: Callable[[], object], *, request: bool | None = None) -> None:
        """Drive until it holds; without a stated request, one that is raised again every 50 periods."""
        begin, number = time.monotonic(), 0
        while not condition():
            assert time.monotonic() - begin < PATIENCE_S, f"it did not happen: {self.statuses[-1:]}"
            number += 1
            self.period(request=number % 50 > 5 if request is None else request)

    def into_control(self) -> None:
        self.largest_action = 0.0
        self.until(lambda: self.largest_action > 0.0)
