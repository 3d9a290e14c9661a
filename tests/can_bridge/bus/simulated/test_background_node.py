"""Other nodes' traffic on the simulated bus."""

from dataclasses import replace
from itertools import pairwise

from can_bridge.bus.simulated.background_node import send_background
from can_bridge.bus.simulated.medium import Transmission
from can_bridge.timing.response_time import PeriodicMessage
from contract.config.vehicle import BusConfig
from tests.can_bridge.bus.simulated.disturbing import bus_of

MS = 10**6
FAST = PeriodicMessage(name="fast", frame_id=0x100, is_fd=True, length=8, period_ns=10 * MS, offset_ns=3 * MS)
SLOW = PeriodicMessage(
    name="slow", frame_id=0x1ABCDE, is_extended=True, is_fd=False, length=2, period_ns=50 * MS, jitter_ns=4 * MS
)


def sent(*messages: PeriodicMessage, seed: int = 1, drift_ppm: float = 0.0) -> list[Transmission]:
    bus, seen, port, _ = bus_of("background", "other", config=BusConfig())
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
