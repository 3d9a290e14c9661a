"""Faults in a port act between the calls of its node."""

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from firmware_sim.bench.run_faults import LOOK_NS, NodeFaults, parse_node_fault


def test_a_delayed_frame_is_there_when_it_is_due_on_a_bus_that_is_quiet():
    """No other event would let the loop look: within one look of the 2 ms."""
    bus = SimulatedBus(BusConfig())
    vehicle, ecu = bus.port("vehicle"), bus.port("ecu")
    port = NodeFaults([parse_node_fault("ecu:delay:delay_s=0.002")], bus, 0).around("ecu", ecu)
    vehicle.send(Frame(frame_id=1, data=b"", is_fd=True))
    assert bus.advance_until(10_000_000, lambda: bool(port.receive_all()))
    assert 2_000_000 < bus.now_ns <= 2_000_000 + 200_000 + LOOK_NS


def test_a_babbling_node_babbles_between_its_calls_and_hears_all():
    """4,504 classic frames of eight bytes a second are the most that 500 kbit/s carry, and the others wait for ever."""
    bus = SimulatedBus(BusConfig())
    vehicle, ecu = bus.port("vehicle"), bus.port("ecu")
    port = NodeFaults([parse_node_fault("vehicle:babble@0..0.1")], bus, 0).around("vehicle", vehicle)
    bus.advance_to(1_000_000)
    ecu.send(Frame(frame_id=1, data=b"", is_fd=True))
    bus.advance_to(100_000_000)
    babbled = ecu.receive_all()
    assert 0.1 * 3_500 < len(babbled) < 0.1 * 4_504
    assert {frame.frame_id for frame in babbled} == {0}
    assert port.receive_all() == []
    bus.advance_to(200_000_000)
    assert [frame.frame_id for frame in port.receive_all()] == [1]
