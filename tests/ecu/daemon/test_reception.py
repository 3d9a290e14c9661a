"""Receptions in the ECU's own time, whatever is done to the date."""

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e.profiles import E2eSender
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import FD
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND, PRESSURE
from ecu.daemon.reception import LONGEST_AGE_NS, ROOM, FrameReception, received_ns
from tests.each import each
from tests.examples import examples

HOUR = 3_600_000_000_000
NOW, DATE = 50 * HOUR, 20_000 * 24 * HOUR


def inbox(interface: str, *, date=lambda: DATE, monotonic=lambda: NOW) -> FrameReception:
    return FrameReception(messages=FD, interface=interface, monotonic_ns=monotonic, date_ns=date)


def pressure(stamp_ns: int = 0) -> Frame:
    return Frame(frame_id=PRESSURE.frame_id, data=bytes(PRESSURE.length), timestamp_ns=stamp_ns)


@given(age=st.integers(0, 10**7), step=st.integers(-(10**18), 10**18))
@examples(200)
def test_a_date_that_is_set_between_stamp_and_look_does_bounded_harm(age, step):
    """Set on: the frame looks old, and is not planned on. Set back: it looks as if it came now, never later."""
    moved = received_ns(DATE - age, monotonic_ns=NOW, date_ns=DATE + step)
    assert NOW - LONGEST_AGE_NS <= moved <= NOW
    if step >= 0:
        assert moved <= NOW - age


@each("interface", ["udp_multicast", "socketcan", "slcan", "virtual", "pcan", "python-can"])
def test_a_frame_is_as_old_as_its_stamp_where_its_clock_is_known(interface):
    box, stamps = inbox(interface), (DATE - 7_000_000, 0, 10**19)
    for stamp in stamps:
        box.put(pressure(stamp))
    waited, *others = (NOW - frame.timestamp_ns for frame in box.take()[0])
    if interface in ("virtual", "pcan", "python-can"):
        assert (waited, others) == (0, [0, 0])
    else:
        assert waited == 7_000_000


def test_frames_by_the_ecus_own_names_are_kept_for_the_step_that_judges_them_and_a_flood_takes_bounded_room():
    box = inbox("virtual")
    for spec, times in ((JET_COMMAND, 3), (ECU_STATUS, 2), (PRESSURE, 1)):
        for _ in range(times):
            box.put(E2eSender(spec).frame(bytes(spec.protected), now_ns=0))
    box.put(Frame(frame_id=0x55, data=b""))
    pressures, others = box.take()
    assert (len(pressures), len(others), box.received) == (1, 5, 6)
    assert box.take() == ([], [])
    for _ in range(ROOM + 10):
        box.put(pressure())
    assert (len(box.take()[0]), box.dropped) == (ROOM, 10)
