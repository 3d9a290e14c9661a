"""How made-up messages fill a bus, and what a periodic message cannot be."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.timing.background import PERIODS_MS, made_up
from can_bridge.timing.periodic_message import PeriodicMessage
from can_bridge.wire.message_specs import SPECS
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError
from tests.examples import examples
from tests.refused import refused

OURS = tuple(spec.frame_id for spec in SPECS)
TAKEN = (0x100, 0x150)


def message(**changes: Any) -> PeriodicMessage:
    usual: dict[str, Any] = {"name": "Some", "frame_id": 0x100, "is_fd": False, "length": 8, "period_ns": 10**7}
    return PeriodicMessage(**{**usual, **changes})


def test_what_no_node_could_send_is_refused():
    for changes, culprit in [
        ({"frame_id": 0x800}, "frame id 0x800"),
        ({"length": 9}, "frame of 9 bytes"),
        ({"period_ns": 0}, "Some: period 0 ns"),
        ({"offset_ns": -1}, "Some: offset -1 ns"),
    ]:
        with refused(ValueError, culprit):
            message(**changes)
    for load, taken, remedy in [
        (1e-5, TAKEN, r"load = 1e-05: less than one message a second"),
        # Made-up messages have identifiers from 0x010 to 0x6ff.
        (0.9, range(0x20, 0x800), r"load = 0\.9: needs more than the 16 free identifiers"),
    ]:
        with refused(ConfigError, remedy):
            made_up(load, BusConfig(), taken, seed=0)


BUSES = st.builds(BusConfig, frames=st.sampled_from(["fd", "classic"]), nominal_bitrate=st.just(500_000))


@examples(50)
@given(load=st.floats(0.02, 0.99), bus=BUSES, seed=st.integers(0, 2**32))
def test_made_up_messages_are_those_of_a_vehicle_and_fill_their_share(load, bus, seed):
    messages = made_up(load, bus, TAKEN, seed=seed)
    assert made_up(load, bus, TAKEN, seed=seed) == messages != made_up(load, bus, TAKEN, seed=seed + 1)
    taken = sum(one.worst_ns(bus) / one.period_ns for one in messages)
    # One frame a second, the rarest, is the most that is left over: 64 bytes of CAN FD, or 8 of classic CAN.
    rarest = message(is_fd=bus.frames == "fd", length=64 if bus.frames == "fd" else 8).worst_ns(bus) / 1e9
    assert load - rarest - 1e-9 < taken <= load + 1e-9  # 1e-9: sums of floats
    ids = [one.frame_id for one in messages]
    assert ids == sorted(set(ids))
    assert not set(ids) & {*OURS, *TAKEN}
    assert all(one.is_fd == (bus.frames == "fd") for one in messages)
    assert {one.period_ns for one in messages} <= {ms * 10**6 for ms in PERIODS_MS}
    assert [one.period_ns for one in messages] == sorted(one.period_ns for one in messages)
    assert all(0 <= one.offset_ns < one.period_ns for one in messages)
    if len(messages) > 1:
        assert ids[0] < min(TAKEN)
        assert ids[-1] > max(TAKEN)
