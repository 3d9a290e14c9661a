from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.faults.clocks import ClockDrift
from tests.can_bridge.bus.faults.links import numbered

S = 10**9


def test_the_clock_shows_what_its_drift_and_offset_make_of_the_time():
    for fault, true_ns, local_ns in [
        (ClockDrift(ppm=100.0), 1000 * S, 1000 * S + S // 10),
        (ClockDrift(ppm=-100.0), 1000 * S, 1000 * S - S // 10),
        (ClockDrift(offset_s=0.25), 7, 7 + S // 4),
        (ClockDrift(offset_s=-1.0), S // 2, 0),
        (ClockDrift(ppm=50.0, start_s=100.0), 99 * S, 99 * S),
        (ClockDrift(ppm=50.0, start_s=100.0), 300 * S, 300 * S + 10_000_000),
        (ClockDrift(ppm=50.0, start_s=100.0, end_s=300.0), 300 * S, 300 * S),
    ]:
        assert fault.local_ns(true_ns) == local_ns, (fault, true_ns, local_ns)
        assert fault.drifting(partial(int, true_ns))() == local_ns, (fault, true_ns, local_ns)


@given(st.floats(-15_800.0, 15_800.0), st.floats(-1.0, 1.0), st.lists(st.integers(0, 10**15), min_size=2, max_size=20))
def test_a_drifting_clock_never_runs_backwards(ppm, offset_s, times):
    fault = ClockDrift(ppm=ppm, offset_s=offset_s)
    local = [fault.local_ns(t) for t in sorted(times)]
    assert local == sorted(local)


def test_received_frames_bear_the_stamps_of_the_drifting_clock(link):
    fault = ClockDrift(ppm=10_000.0, offset_s=0.001, end_s=1.0)
    faulty = link.wrapped(link.other, fault)
    for _ in range(60):
        link.one.send(numbered(3, now_ns=link.now_ns))
        link.advance()
        (local,), (true,) = faulty.receive_all(), link.listener.receive_all()
        gained_ns = S // 1000 + round(true.timestamp_ns * 0.01) if true.timestamp_ns < S else 0
        assert abs(local.timestamp_ns - true.timestamp_ns - gained_ns) <= 1  # rounded to whole ns
        assert local.data == true.data
    assert faulty.injectors[0].acted == 50
