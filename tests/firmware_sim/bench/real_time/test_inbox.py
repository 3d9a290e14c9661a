"""Frames between the receiving thread and the loop."""

from threading import Thread

from can_bridge.wire.frame import Frame
from firmware_sim.bench.real_time.inbox import CAPACITY, Inbox


def frame(number: int = 0) -> Frame:
    return Frame(frame_id=0x130, data=number.to_bytes(8, "big"), timestamp_ns=1_700_000_000_000_000_000, is_fd=True)


def test_frames_come_out_by_when_they_came_in() -> None:
    clock = iter([10, 20, 30])
    inbox = Inbox(lambda: next(clock))
    for number in range(3):
        inbox.put(frame(number))
    # What arrives at the very boundary belongs to the next period.
    assert [item.timestamp_ns for item in inbox.before(20)] == [10]
    assert [item.data[-1] for item in inbox.before(31)] == [1, 2]
    assert inbox.before(10**18) == []


def test_the_bus_clock_does_not_reach_the_frames() -> None:
    inbox = Inbox(lambda: 42)
    inbox.put(frame())
    assert inbox.before(43)[0].timestamp_ns == 42


def test_a_flood_costs_the_oldest_and_is_counted() -> None:
    inbox = Inbox(lambda: 0)
    for number in range(CAPACITY + 7):
        inbox.put(frame(number))
    kept = inbox.before(1)
    assert (len(kept), inbox.lost) == (CAPACITY, 7)
    assert kept[0].data == (7).to_bytes(8, "big")


def test_nothing_is_lost_between_two_threads() -> None:
    inbox, taken = Inbox(), []
    sender = Thread(target=lambda: [inbox.put(frame(number)) for number in range(3000)])
    sender.start()
    while sender.is_alive():
        taken += inbox.before(2**62)
    sender.join()
    taken += inbox.before(2**62)
    assert [int.from_bytes(item.data, "big") for item in taken] == list(range(3000))
