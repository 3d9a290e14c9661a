from collections import Counter

import can
import pytest

from can_bridge.tools.recorder import Recorder
from contract.errors import BusError


def test_everything_that_comes_is_written_and_losses_are_counted():
    messages = [can.Message(arbitration_id=i, is_error_frame=i % 3 == 0) for i in range(9)]
    waiting: list[can.Message | None] = [None, *messages[:4], None, None, *messages[4:]]
    written: list[can.Message] = []
    recorder = Recorder(written.append, lambda message: "error frames" if message.is_error_frame else "")
    recorder.run(lambda wait_s: waiting.pop(0), is_over=lambda frames: not waiting)
    assert [one.arbitration_id for one in written] == list(range(9))
    assert (recorder.frames, recorder.not_kept) == (9, Counter({"error frames": 3}))


def test_a_bus_that_fails_leaves_the_count_of_what_was_written():
    waiting = [can.Message(), can.Message()]

    def receive(wait_s: float) -> can.Message:
        if not waiting:
            raise BusError("CAN bus failed: unplugged")
        return waiting.pop()

    written: list[can.Message] = []
    recorder = Recorder(written.append, lambda message: "")
    with pytest.raises(BusError, match="unplugged"):
        recorder.run(receive, is_over=lambda frames: False)
    assert recorder.frames == len(written) == 2


def test_what_waits_when_it_is_stopped_is_written_too_and_no_more():
    waiting: list[can.Message | None] = [can.Message(arbitration_id=i) for i in range(5)]
    written: list[can.Message] = []
    recorder = Recorder(written.append, lambda message: "")
    waits: list[float] = []

    def receive(wait_s: float) -> can.Message | None:
        waits.append(wait_s)
        return waiting.pop(0) if waiting else None

    recorder.run(receive, is_over=lambda frames: frames == 1)
    recorder.drain(receive, most=2)
    assert recorder.frames == 3
    recorder.drain(receive, most=10)
    assert [one.arbitration_id for one in written] == list(range(5))
    # It does not wait for more.
    assert waits[1:] == [0.0] * 5
