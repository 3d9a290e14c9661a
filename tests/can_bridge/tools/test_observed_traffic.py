"""Rates, ages and losses against streams whose answer is known."""

from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import FrameCheck
from can_bridge.tools.observed_traffic import RATE_OVER, SILENT_AFTER, Traffic
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE_SECURED, SPECS, MessageSpec
from contract.config.vehicle import E2eConfig
from tests.examples import examples

E2E = E2eConfig()


def frame(spec: MessageSpec, counter: int, t_ns: int = 0) -> Frame:
    protected = profile_of(spec).protect(bytes(spec.protected), data_id=spec.data_id, counter=counter)
    data = protected + bytes(spec.length - spec.protected)
    return Frame(frame_id=spec.frame_id, data=data, timestamp_ns=t_ns, is_fd=spec.is_fd)


def after(frames: list[Frame]) -> Traffic:
    traffic = Traffic(E2E)
    for one in frames:
        traffic.add(one)
    return traffic


@given(period_ns=st.integers(1, 10**10), count=st.integers(2, 3 * RATE_OVER), begin=st.integers(0, 2 * 10**18))
def test_rate_and_age_of_a_periodic_message(period_ns, count, begin):
    traffic = after([Frame(frame_id=1, data=b"", timestamp_ns=begin + i * period_ns) for i in range(count)])
    last = begin + (count - 1) * period_ns
    # Whole ns in, one division: exact to a rounding or two.
    assert traffic.rate_hz(last) == pytest.approx(1e9 / period_ns, rel=1e-12)
    assert traffic.mean_rate_hz == pytest.approx(1e9 / period_ns, rel=1e-12)
    assert traffic.age_ns(last + 17) == 17
    assert (traffic.count, traffic.first_ns, traffic.last_ns) == (count, begin, last)
    assert traffic.rate_hz(last + int(SILENT_AFTER * period_ns) + 1) == 0.0
    assert len(traffic.recent_ns) <= RATE_OVER + 1


def test_rate_follows_a_change_and_needs_two_times():
    gaps = [10_000_000] * 50 + [50_000_000] * RATE_OVER
    traffic = after([Frame(frame_id=1, data=b"", timestamp_ns=t) for t in accumulate([0, *gaps])])
    assert (traffic.rate_hz(traffic.last_ns), traffic.mean_rate_hz) == pytest.approx((20.0, 70 / 1.5))
    for times in [[5], [5, 5], [9, 3]]:
        traffic = after([Frame(frame_id=1, data=b"", timestamp_ns=t) for t in times])
        assert (traffic.rate_hz(9), traffic.mean_rate_hz, traffic.age_ns(0)) == (0.0, 0.0, 0), times


@examples(60)
@given(spec=st.sampled_from(SPECS), data=st.data())
def test_losses_are_those_that_were_made(spec, data):
    """Fewer than a counter's period in a row: a counter cannot show more."""
    period = profile_of(spec).counter_period
    gaps = data.draw(st.lists(st.integers(0, period - 2), max_size=30))
    counters = accumulate([data.draw(st.integers(0, period - 1)), *(gap + 1 for gap in gaps)])
    traffic = after([frame(spec, counter % period) for counter in counters])
    assert traffic.lost == sum(gaps)
    assert traffic.receiver.count(FrameCheck.ERROR) == 0
    assert traffic.refused == sum(gap + 1 > E2E.max_delta for gap in gaps)


def test_frames_that_are_not_their_messages_fail_their_check():
    """A secured message of another length, whose protected part alone would pass; a classic frame for a CAN FD one."""
    secured, command = frame(PRESSURE_SECURED, 0), frame(JET_COMMAND, 0)
    for one in (
        Frame(frame_id=secured.frame_id, data=secured.data[:16]),
        Frame(frame_id=command.frame_id, data=command.data, is_fd=False),
    ):
        assert after([one]).check is FrameCheck.ERROR, one
    traffic = after([command, command, frame(JET_COMMAND, 2 + E2E.max_delta)])
    assert (traffic.check, traffic.lost, traffic.refused) == (FrameCheck.WRONG_SEQUENCE, 1 + E2E.max_delta, 2)
