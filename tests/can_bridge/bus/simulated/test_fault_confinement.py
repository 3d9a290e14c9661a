"""The nodes of the simulated bus: error counters, priorities, and other nodes' traffic."""

from dataclasses import replace
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.bus.simulated.attempt import AttemptVerdict, counted
from can_bridge.bus.simulated.background_node import send_background
from can_bridge.bus.simulated.medium import SimulatedBus, Transmission
from can_bridge.timing.response_time import PeriodicMessage
from can_bridge.wire.frame import Frame, priority
from can_bridge.wire.frame_bits import sent_bits
from contract.config.vehicle import BusConfig

ACTIVE, PASSIVE, OFF = BusState.ERROR_ACTIVE, BusState.ERROR_PASSIVE, BusState.BUS_OFF


def at(tx_errors: int, rx_errors: int) -> BusHealth:
    state = PASSIVE if max(tx_errors, rx_errors) >= 128 else ACTIVE
    return BusHealth(state=state, tx_errors=tx_errors, rx_errors=rx_errors)


def test_each_verdict_counts_by_its_rules_and_a_node_is_passive_from_128_and_off_from_256_on():
    for verdict, before, after in [
        (AttemptVerdict.RECEIVE_ERROR, (5, 7), at(5, 8)),
        (AttemptVerdict.RECEIVE_ERROR, (0, 127), at(0, 128)),
        (AttemptVerdict.SIGNALLED_FIRST, (0, 0), at(0, 9)),
        (AttemptVerdict.SIGNALLED_FIRST, (0, 250), at(0, 255)),  # a register of eight bits
        (AttemptVerdict.TRANSMIT_ERROR, (5, 7), at(13, 7)),
        (AttemptVerdict.TRANSMIT_ERROR, (120, 0), at(128, 0)),
        (AttemptVerdict.TRANSMIT_ERROR, (247, 0), at(255, 0)),
        (AttemptVerdict.ARBITRATION_STUFF, (5, 7), at(5, 7)),
        *(
            (AttemptVerdict.UNACKNOWLEDGED, (tx, 0), at(after, 0))
            for tx, after in [(0, 8), (120, 128), (127, 135), (128, 128), (255, 255)]
        ),
        *((AttemptVerdict.SENT, (tx, 3), at(max(tx - 1, 0), 3)) for tx in [0, 1, 8, 128, 255]),
        *((AttemptVerdict.HEARD, (3, rx), at(3, max(rx - 1, 0))) for rx in [0, 1, 127]),
        # The standard allows 119 to 127.
        *((AttemptVerdict.HEARD, (0, rx), at(0, 127)) for rx in [128, 135, 255]),
    ]:
        assert counted(at(*before), verdict) == after, (verdict, before)
    off = counted(at(248, 90), AttemptVerdict.TRANSMIT_ERROR)
    assert off == BusHealth(state=OFF, tx_errors=256, rx_errors=90, bus_off=1)
    # It stays off whatever happens, and counts once.
    for verdict in (AttemptVerdict.SENT, AttemptVerdict.HEARD, AttemptVerdict.TRANSMIT_ERROR):
        off = counted(off, verdict)
        assert (off.state, off.bus_off) == (OFF, 1), verdict


@st.composite
def frames(draw) -> Frame:
    extended = draw(st.booleans())
    # Few leading bits, so that the two formats meet.
    base, rest = draw(st.integers(0, 3)), draw(st.integers(0, 0x3FFFF))
    return Frame(
        frame_id=base << 18 | rest if extended else base,
        data=draw(st.binary(max_size=2)),
        is_extended=extended,
        is_fd=draw(st.booleans()),
    )


@given(one=frames(), other=frames())
def test_the_smaller_priority_is_the_one_whose_bits_win(one, other):
    """The dominant one, 0, prevails at the first bit in which two frames with stuff bits differ."""
    if priority(one) != priority(other):
        assert (priority(one) < priority(other)) == (sent_bits(one).stuffed < sent_bits(other).stuffed)
    else:
        assert (one.frame_id, one.is_extended) == (other.frame_id, other.is_extended)


MS = 10**6
FAST = PeriodicMessage(name="fast", frame_id=0x100, is_fd=True, length=8, period_ns=10 * MS, offset_ns=3 * MS)
SLOW = PeriodicMessage(
    name="slow", frame_id=0x1ABCDE, is_extended=True, is_fd=False, length=2, period_ns=50 * MS, jitter_ns=4 * MS
)


def sent(*messages: PeriodicMessage, seed: int = 1, drift_ppm: float = 0.0) -> list[Transmission]:
    seen: list[Transmission] = []
    bus = SimulatedBus(BusConfig(), observe=seen.append)
    port = bus.port("background")
    bus.port()
    send_background(bus, port, messages, seed, drift_ppm=drift_ppm)
    bus.advance_to(1000 * MS)
    assert port.refused == 0
    return seen


def test_a_message_comes_at_its_offset_and_every_period_late_by_its_jitter_alone():
    seen = sent(FAST, SLOW)
    assert sent(FAST, SLOW) == seen != sent(FAST, SLOW, seed=2)
    fast, slow = ([item for item in seen if item.frame.is_extended is extended] for extended in (False, True))
    assert {(item.frame.frame_id, item.frame.is_fd, len(item.frame.data)) for item in fast} == {(0x100, True, 8)}
    assert {(item.frame.frame_id, item.frame.is_fd, len(item.frame.data)) for item in slow} == {(0x1ABCDE, False, 2)}
    assert [item.queued_ns for item in fast] == [3 * MS + k * 10 * MS for k in range(100)]
    late = [item.queued_ns - k * 50 * MS for k, item in enumerate(slow)]
    assert (len(late), all(0 <= ns <= 4 * MS for ns in late)) == (20, True)
    assert len(set(late)) > 15
    # Random contents, and those of one message do not depend on another.
    assert len({item.frame.data for item in seen}) > 110
    assert [item.frame.data for item in sent(FAST)] == [item.frame.data for item in fast]


def test_clocks_drift_apart_slowly_and_never_run_fast():
    both = sent(FAST, replace(FAST, frame_id=0x101, offset_ns=8 * MS), drift_ppm=1000.0)
    late = []
    for frame_id, offset_ns in ((0x100, 3 * MS), (0x101, 8 * MS)):
        queued = [item.queued_ns - offset_ns for item in both if item.frame.frame_id == frame_id]
        steps = {after - before for before, after in pairwise(queued)}
        assert len(steps) == 1
        assert 0 < steps.pop() - FAST.period_ns < 0.001 * FAST.period_ns
        late.append(queued[-1] - 99 * FAST.period_ns)
    assert late[0] != late[1]
