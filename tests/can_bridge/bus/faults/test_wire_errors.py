"""Wrong bits on the wire: as many as the rate says, where it says."""

from can_bridge.bus.faults.wire_errors import WireErrors
from can_bridge.bus.interface import BusState
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_bits
from contract.config.vehicle import BusConfig
from contract.errors import BusError

FRAME = Frame(frame_id=0x555, data=bytes([0x55] * 8), is_fd=False)
BITS = sum(frame_bits(FRAME)) - 3


def test_frames_are_hit_as_often_as_independent_bits_make_them():
    for rate in [1e-4, 1e-2, 0.5]:
        hook = WireErrors(bit_error_rate=rate).hook(1)
        n = 4_000
        places = [place for _ in range(n) if (place := hook(FRAME, "any", 0)) is not None]
        hit = 1 - (1 - rate) ** BITS
        # Five standard deviations of a binomial number.
        assert abs(len(places) - n * hit) < 5 * (n * hit * (1 - hit)) ** 0.5 + 1e-9, rate
        assert 0 <= min(places) <= max(places) < BITS, rate
        # Place k is first with (1 - rate)^k rate: the mean over a frame that is hit, by summation.
        law = [(1 - rate) ** k * rate / hit for k in range(BITS)]
        mean = sum(k * p for k, p in enumerate(law))
        spread = sum((k - mean) ** 2 * p for k, p in enumerate(law)) ** 0.5
        assert abs(sum(places) / len(places) - mean) < 5 * spread / len(places) ** 0.5, rate


def test_only_the_named_nodes_and_frames_are_hit_in_the_span():
    hook = WireErrors(bit_error_rate=1.0, nodes=("ecu",), frame_ids=(0x555,), start_s=1.0, end_s=2.0).hook(1)
    hit = [hook(FRAME, "ecu", at) for at in (999_999_999, 10**9, 2 * 10**9 - 1, 2 * 10**9)]
    assert hit == [None, 0, 0, None]
    assert hook(FRAME, "vehicle", 10**9) is None
    assert hook(Frame(frame_id=0x120, data=b""), "ecu", 10**9) is None


def node_on_a_disturbed_bus(errors: WireErrors, *, frames: int, mishears: bool = False):
    """A node that sends every 5 ms and one that listens; what arrived and the sender's health at each sending."""
    hook = errors.hook(1)
    bus = SimulatedBus(BusConfig(), corrupts=None if mishears else hook, mishears=hook if mishears else None)
    sender, listener = bus.port("sender"), bus.port("listener")
    health, refused = [], []
    for number in range(frames):
        bus.advance_to(number * 5_000_000)
        health.append(sender.health())
        try:
            sender.send(Frame(frame_id=0x120, data=number.to_bytes(4, "little")))
        except BusError:
            refused.append(number)
    bus.advance_to(frames * 5_000_000)
    arrived = [int.from_bytes(frame.data, "little") for frame in listener.receive_all()]
    return arrived, refused, health, listener.health()


def test_a_node_whose_bits_are_all_wrong_goes_bus_off_and_comes_back():
    """32 attempts in a row at 8 each reach 256; 128 x 11 recessive bits later, 2.8 ms, it is back."""
    errors = WireErrors(bit_error_rate=0.3, nodes=("sender",), start_s=0.1, end_s=0.2)
    arrived, refused, health, other = node_on_a_disturbed_bus(errors, frames=100)
    during, after = health[21:41], health[45:]
    assert any(item.state is BusState.BUS_OFF for item in during)
    assert health[-1].bus_off >= 1
    assert refused  # while it was off
    assert set(range(20)) <= set(arrived)
    # Nothing gets through in the span, everything from the second period behind it on.
    assert not set(arrived) & set(range(20, 38))
    assert arrived[-58:] == list(range(42, 100))
    assert {item.state for item in after} == {BusState.ERROR_ACTIVE}
    # The listener is not to blame: it never goes off.
    assert other.bus_off == 0
