"""What holds for every fault: without effect it is no fault, it acts and clears, it nests, its draws are its own."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.faults.fault import BusFault, WrappedBus, wrap
from can_bridge.bus.faults.frame_faults import Delay, Drop, Duplicate, FlipBits, WireErrors
from can_bridge.bus.faults.text import parse_fault
from can_bridge.bus.interface import HEALTHY, Bus, BusHealth
from can_bridge.wire.frame import Frame
from tests.can_bridge.bus.faults.links import PERIOD_NS, PERIOD_S, Link, number_of, numbered, numbers, simulated_link
from tests.examples import examples


def faults_of(texts: str) -> list[BusFault]:
    return [parse_fault(text) for text in texts.split()]


NULL_FAULTS = faults_of(
    "drop:probability=0 drop:probability=0,at=receive burst_loss:loss=0,mean_burst=3 duplicate:probability=0 "
    "flip_bits:probability=0 delay:delay_s=0 reorder:window=1 slow_consumer:frames_per_call=100,queue=100 clock_drift"
)
"""Faults whose parameters let nothing happen."""
RANDOM_FAULTS = faults_of(
    "drop:probability=0.4 burst_loss:loss=0.4,mean_burst=3,at=receive duplicate:probability=0.5 "
    "flip_bits:probability=0.5,bits=2 delay:delay_s=0.03,jitter_s=0.05 reorder:window=3 babble:rate_hz=300"
)
FAULTS = RANDOM_FAULTS + faults_of(
    "flip_bits:probability=0.5,before_crc=true stuck_at:at=receive stuck_at:counter_runs=true disconnect "
    "slow_consumer:frames_per_call=1,queue=2 clock_drift:ppm=1000"
)


def carried(link: Link, ports: Sequence[Bus], bursts: Sequence[int]) -> list[list[Frame]]:
    """What each side received, with frames in both directions; a rest after them lets everything come out."""
    received: list[list[Frame]] = [[], []]
    for burst in [*bursts, *[0] * 20]:
        for number in range(burst):
            for port, frame_id in zip(ports, (0x120, 0x130), strict=True):
                port.send(numbered(100 * link.now_ns + number, frame_id=frame_id, now_ns=link.now_ns))
        link.advance()
        for frames, port in zip(received, ports, strict=True):
            frames += port.receive_all()
    return received


@examples(10)
@given(bursts=st.lists(st.integers(0, 4), max_size=12), seed=st.integers(0, 3))
def test_a_fault_without_effect_or_outside_its_span_is_none(bursts, seed):
    plain = simulated_link()
    expected = carried(plain, (plain.one, plain.other), bursts)
    for fault in (*NULL_FAULTS, *(replace(fault, start_s=100.0) for fault in FAULTS)):
        faulty = simulated_link()
        wrapped = [faulty.wrapped(port, fault, seed=seed) for port in (faulty.one, faulty.other)]
        assert carried(faulty, wrapped, bursts) == expected, fault
        assert [port.injectors[0].acted for port in wrapped] == [0, 0], fault


def acts_and_clears(link: Link, fault: BusFault) -> None:
    spanned = replace(fault, start_s=9.5 * PERIOD_S, end_s=19.5 * PERIOD_S)
    wrapped = [link.wrapped(port, spanned) for port in (link.one, link.other)]
    for period in range(40):
        wrapped[0].send(numbered(period, now_ns=link.now_ns))
        wrapped[0].send(numbered(period, frame_id=0x7E0, now_ns=link.now_ns))
        wrapped[1].send(numbered(period, frame_id=0x130, now_ns=link.now_ns))
        link.advance()
        received = [port.receive_all() for port in wrapped]
        link.listener.receive_all()
        if not 9 <= period < 25:
            expected = [[(0x130, period)], [(0x120, period), (0x7E0, period)]]
            got = [sorted((frame.frame_id, number_of(frame)) for frame in frames) for frames in received]
            assert got == expected, (fault, period)
    assert sum(port.injectors[0].acted for port in wrapped) > 0, fault


def test_every_fault_acts_and_clears(config):
    """Whatever it does, from the third period behind its end all is as it was without; over python-can's bus, too."""
    with ExitStack() as open_buses:
        virtual = Link([open_buses.enter_context(PythonCanBus.open(config)) for _ in range(3)])
        for fault in FAULTS:
            acts_and_clears(simulated_link(), fault)
            virtual.now_ns = 0
            acts_and_clears(virtual, fault)


def test_the_seed_decides():
    for fault in RANDOM_FAULTS:

        def run(seed: int, fault: BusFault = fault) -> str:
            link = simulated_link()
            wrapped = [link.wrapped(port, fault, seed=seed) for port in (link.one, link.other)]
            received = link.stream(wrapped[0], wrapped[1], 40)
            return repr([[frame.data for frame in frames] for frames in (*received, link.listener.receive_all())])

        assert run(1) == run(1), fault
        assert len({run(seed) for seed in range(3)}) == 3, fault
    hooks = [WireErrors(bit_error_rate=0.01).hook(seed) for seed in (1, 1, 2)]
    hit = [[hook(numbered(0), "any", 0) for _ in range(100)] for hook in hooks]
    assert hit[0] == hit[1] != hit[2]


def test_faults_nest_from_the_wire_to_the_node(link):
    """A frame is copied and each copy dropped or not, or it is dropped and so not copied: the counts show which."""
    drop, copy = Drop(probability=0.5, at="receive"), Duplicate(at="receive")
    inner_drop, inner_copy = link.wrapped(link.other, drop, copy), link.wrapped(link.listener, copy, drop)
    for number in range(200):
        link.one.send(numbered(number))
        link.advance()
    received = inner_drop.receive_all()
    dropped, copied = (injector.acted for injector in inner_drop.injectors)
    assert (dropped + copied, len(received)) == (200, 2 * copied)
    received = inner_copy.receive_all()
    copied, dropped = (injector.acted for injector in inner_copy.injectors)
    assert (copied, len(received)) == (200, 400 - dropped)
    assert any(received.count(frame) == 1 for frame in received)


def test_each_fault_draws_for_itself(link):
    def lost(*before):
        link = simulated_link()
        faulty = link.wrapped(link.one, *before, Drop(probability=0.5), seed=7)
        return numbers(link.stream(faulty, link.other, 100))

    # In the same place behind two others that draw, or not.
    assert lost(FlipBits(probability=0.0, frame_ids=(0x7FF,))) == lost(Duplicate(probability=0.5, at="receive"))
    # Two equal ones draw differently, or the second would flip back what the first flipped.
    received = link.stream(link.wrapped(link.one, FlipBits(), FlipBits()), link.other, 50)
    # Two bits of 64 are the same by chance once in 64 frames; half of 50 is out of reach.
    assert sum(number_of(frames[0]) != number for number, frames in enumerate(received)) > 25


def test_health_comes_from_beneath_and_is_good_where_it_is_not_known(link):
    class Ill(WrappedBus):
        def health(self) -> BusHealth:
            return BusHealth(tx_errors=136)

    class Unaware:
        send = link.one.send
        receive_all = link.one.receive_all

    for faults in ((), (Drop(probability=0.1), Delay(delay_s=0.1))):
        assert wrap(Ill(link.one), faults, link.clock).health().tx_errors == 136, faults
        assert wrap(Unaware(), faults, link.clock).health() == HEALTHY, faults


def test_arrivals_are_stamps_where_those_can_be_meant(link):
    class Received(WrappedBus):
        stamps: Sequence[int]

        def receive_all(self) -> list[Frame]:
            return [numbered(0, now_ns=stamp) for stamp in self.stamps]

    bus = Received(link.one)
    (port,) = link.wrapped(bus, Drop(probability=0.0)).injectors
    for now_ns, bus.stamps, expected in (
        # 5 is before the frame ahead of it, 99 is in the future, and what follows was not there before that.
        (10, (3, 7, 5, 99, 8), [3, 7, 7, 10, 10]),
        (20, (9, 12, 10**18), [20, 20, 20]),
        (PERIOD_NS, (21,), [21]),
    ):
        assert [arrived_ns for arrived_ns, _ in port.arrived(now_ns)] == expected
