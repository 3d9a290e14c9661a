"""What a run keeps of its bus."""

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import FD
from contract.config.vehicle import BusConfig
from firmware_sim.runs.bus_traffic import WaitingTimes

COMMAND = Frame(frame_id=FD.command.spec.frame_id, data=bytes(8))
PRESSURE = Frame(frame_id=FD.pressure.spec.frame_id, data=bytes(16))


def test_the_longest_wait_of_our_messages_is_kept():
    waits = WaitingTimes(messages=FD)
    bus = SimulatedBus(BusConfig(), observe=waits)
    one, other = bus.port(), bus.port()
    one.send(COMMAND)
    bus.advance_to(10**7)
    for _ in range(2):
        one.send(PRESSURE)
    other.send(COMMAND)
    another = Frame(frame_id=COMMAND.frame_id, data=b"", is_extended=True)  # its leading bits are zeros
    other.send(another)
    bus.advance_to(10**8)
    traffic = waits.traffic(bus.activity(), {})
    first_ns, pressure_ns = bus.frame_ns(another), bus.frame_ns(PRESSURE)
    assert traffic.longest_wait_ms == {
        "Pressure": (first_ns + pressure_ns) / 1e6,
        "JetCommand": (first_ns + 2 * pressure_ns) / 1e6,
    }
    assert (traffic.frames, traffic.error_frames) == (5, 0)
    assert traffic.load == bus.activity().load > 0
