"""Frames between the reading thread and the loop."""

from itertools import count
from threading import Thread

from can_bridge.wire.frame import Frame
from ecu.real_time.inbox import Inbox
from tests.each import each


def frame(number: int = 0) -> Frame:
    return Frame(frame_id=0x130, data=number.to_bytes(8, "big"), timestamp_ns=1_700_000_000_000_000_000, is_fd=True)


def numbers(frames: list[Frame]) -> list[int]:
    return [int.from_bytes(item.data, "big") for item in frames]


def test_frames_come_out_once_by_when_they_came_in() -> None:
    clock = count(10, 10)
    inbox = Inbox(lambda item: next(clock), room=100)
    for number in range(3):
        inbox.put(frame(number))
    # What arrives at the very boundary belongs to the next period.
    assert [item.timestamp_ns for item in inbox.before(20)] == [10]
    assert numbers(inbox.take()) == [1, 2]
    assert inbox.before(10**18) == inbox.take() == []


@each("room", [2, 10_000])
def test_between_two_threads_every_frame_is_taken_or_counted(room: int) -> None:
    """With little room it is full again and again, while the loop empties it."""
    inbox, taken = Inbox(lambda item: 0, room=room), list[Frame]()

    def send() -> None:
        for number in range(3000):
            inbox.put(frame(number))

    sender = Thread(target=send)
    sender.start()
    while sender.is_alive():
        taken += inbox.before(1)
    sender.join()
    taken += inbox.before(1)
    assert inbox.received == len(taken) + inbox.dropped == 3000
    assert numbers(taken) == sorted(set(numbers(taken)))
    # A flood costs the oldest: the last one is always there.
    assert numbers(taken)[-1] == 2999
    assert room == 2 or inbox.dropped == 0
