"""A second ECU on the bus."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.e2e.sender import SenderState
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND
from can_bridge.wire.messages import Mode, Reason
from contract import sensors
from contract.config.tree import Config
from contract.errors import BusError
from ecu.ecu import Ecu
from firmware_sim.bench.vehicle_node import VehicleNode
from tests.each import each
from tests.ecu.conftest import RecordingController, make_bundle
from tests.firmware_sim.bench.harness import NAMES

CP = np.cos(np.arange(sensors.COUNT))


class Company:
    """A vehicle and some ECUs on one bus; each ECU steps at its own time after the sampling.

    Attributes:
        actions: of the jets, a period each.
    """

    def __init__(self, vehicle: Config, ecus: list[Ecu], after_ns: list[int]) -> None:
        self.bus = SimulatedBus(vehicle.bus)
        self.node, self.port = VehicleNode(NAMES, vehicle), self.bus.port("vehicle")
        self.ecus, self.after_ns = ecus, after_ns
        self.ports = [self.bus.port(f"ECU {k}") for k in range(len(ecus))]
        self.actions: list[float] = []

    def run(self, periods: int) -> None:
        for _ in range(periods):
            k = len(self.actions)
            start_ns = k * 20_000_000
            self.bus.advance_to(start_ns)
            self.port.send(self.node.sample(CP, enable_request=k >= 2, now_ns=start_ns))
            for ecu, port, after_ns in sorted(
                zip(self.ecus, self.ports, self.after_ns, strict=True), key=lambda one: one[2]
            ):
                self.bus.advance_to(start_ns + after_ns)
                for frame in ecu.step(self.bus.now_ns, port.receive_all(), port.health()):
                    with suppress(BusError):  # bus-off
                        port.send(frame)
            self.bus.advance_to(start_ns + 19_999_999)
            self.actions.append(self.node.apply_commands(self.port.receive_all()).action)


def ecu_of(config: Config, *, commands_before: int = 0) -> Ecu:
    ecu = Ecu(make_bundle(), RecordingController(), config)
    ecu.restore(replace(ecu.state, commands=SenderState(counter=commands_before)))
    return ecu


@each("counters_apart", [0, 1, 3, 128])
def test_two_ecus_that_hear_each_other_shut_the_jets(counters_apart):
    """Whichever of the two streams the vehicle's end-to-end check would have followed."""
    ecus = [ecu_of(Config()), ecu_of(Config(), commands_before=counters_apart)]
    company = Company(Config(), ecus, [1_000_000, 2_000_000])
    company.run(60)
    assert company.actions == [0.0] * 60
    for ecu in ecus:
        assert (ecu.status().state, ecu.status().reason) == (Mode.FAULT, Reason.OTHER_ECU)


def test_a_damaged_command_on_the_bus_is_no_second_ecu():
    ecu = ecu_of(Config())
    company = Company(Config(), [ecu], [1_000_000])
    noise = company.bus.port("noise")
    for _ in range(30):
        noise.send(Frame(frame_id=JET_COMMAND.frame_id, data=bytes(JET_COMMAND.length), is_fd=True))
        company.run(1)
    assert ecu.status().reason is not Reason.OTHER_ECU
