"""The receiver: its state machine against the standard's (AUTOSAR PRS_E2EProtocol, "E2E state machine"), each check of
a frame, and the sender's counter.

O is an OK check, L an OK with some lost, R a repeated one, W a wrong sequence, E an error, - a period without a frame.
"""

import re
from dataclasses import replace
from itertools import product
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e.profiles import PROFILE_5, E2eSender, SenderState, profile_of
from can_bridge.e2e.receiver import E2eReceiver, FrameCheck, StreamState
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE, PRESSURE_CLASSIC, PRESSURE_SECURED, MessageSpec
from contract.config.vehicle import BusConfig, E2eConfig
from contract.errors import ConfigError

CONFIG: Final = E2eConfig(max_delta=4, window=5, min_ok=2, max_errors=2)
LETTERS: Final = dict(zip("OLRWE-", FrameCheck, strict=True))
STEPS: Final = {"O": 1, "L": 2, "R": 0, "W": 100}
NODATA, INIT, VALID, INVALID = StreamState


def frame(counter: int, spec: MessageSpec = PRESSURE, *, good=True, time_ns: int = 0) -> Frame:
    profile = profile_of(spec)
    data = profile.protect(bytes(spec.protected), data_id=spec.data_id, counter=counter % profile.counter_period)
    if not good:
        data = data[:-1] + bytes([data[-1] ^ 1])
    return Frame(frame_id=spec.frame_id, data=data.ljust(spec.length, b"\0"), timestamp_ns=time_ns, is_fd=spec.is_fd)


def frames_for(letters: str, last: int) -> list[Frame]:
    """One period's frames with these checks, after a frame with the counter `last`."""
    made = []
    for letter in letters:
        if letter == "E":
            made.append(frame(last + 1, good=False))
        elif letter != "-":
            last += STEPS[letter]
            made.append(frame(last))
    return made


class AutosarMachine:
    """The standard's own terms: a ring of states, and counts over it; the first check is added when INIT begins."""

    def __init__(self, size: int, min_ok: int, max_error: int) -> None:
        self.ring, self.top = [""] * size, 0
        self.min_ok = {"INIT": min_ok, "VALID": 1, "INVALID": min_ok}
        self.max_error = max_error
        self.state = "NODATA"

    def check(self, letter: str) -> str:
        if self.state == "NODATA":
            if letter not in "E-":
                self.state = "INIT"
                self._add(letter)
            return self.state
        self._add(letter)
        oks, errors = self.ring.count("O") + self.ring.count("L"), self.ring.count("E")
        if errors <= self.max_error and oks >= self.min_ok[self.state]:
            self.state = "VALID"
        elif self.state == "VALID" or errors > self.max_error:
            self.state = "INVALID"
        return self.state

    def _add(self, letter: str) -> None:
        self.ring[self.top] = letter
        self.top = (self.top + 1) % len(self.ring)


@given(
    periods=st.lists(st.text("OOOLRWE", max_size=3), max_size=60),
    sizes=st.integers(1, 8).flatmap(lambda n: st.tuples(st.just(n), st.integers(1, n), st.integers(0, n - 1))),
)
def test_any_story_is_the_standards(periods, sizes):
    """A period is one check: an error whatever else came, else a good one, in any order; each frame is counted."""
    window, min_ok, max_errors = sizes
    made = E2eReceiver(PRESSURE, E2eConfig(window=window, min_ok=min_ok, max_errors=max_errors))
    standard = AutosarMachine(window, min_ok, max_errors)
    for letters in periods:
        last, before = made.state.last_counter, sum(made.state.counts)
        if last is None:
            letters = re.sub("[LRW]", "O", letters, count=1)  # the first frame has nothing to be compared with
        reception = made.tick(frames_for(letters, 255 if last is None else last))
        checks = tuple(LETTERS[letter] for letter in letters or "-")
        assert (reception.checks, sum(made.state.counts) - before) == (checks, len(checks))
        weightiest = next((letter for letter in "EOLWR" if letter in letters), "-")
        assert made.state.stream.name == standard.check(weightiest)


def test_a_step_of_more_than_half_the_four_bit_counter_cannot_be_allowed():
    assert BusConfig(frames="classic", e2e=E2eConfig(max_delta=7)).e2e.max_delta == 7
    with pytest.raises(ConfigError, match=r"bus\.e2e\.max_delta.*1\.\.7"):
        BusConfig(frames="classic", e2e=E2eConfig(max_delta=8))


def test_restarted_sender_is_followed_from_its_second_frame():
    for spec in [PRESSURE, PRESSURE_CLASSIC, PRESSURE_SECURED]:
        made = valid_receiver(spec)
        first, second = made.tick([frame(0, spec)]), made.tick([frame(1, spec)])
        assert (first.checks, first.stream, first.live) == ((FrameCheck.WRONG_SEQUENCE,), VALID, None), spec
        assert (second.checks, second.live) == ((FrameCheck.OK,), frame(1, spec)), spec


def valid_receiver(spec: MessageSpec = PRESSURE) -> E2eReceiver:
    """A receiver whose latest counter is 9."""
    made = E2eReceiver(spec, CONFIG)
    for counter in range(4, 10):
        made.tick([frame(counter, spec)])
    assert made.state.stream is VALID
    return made


def test_every_counter_step_gets_its_check():
    """All steps of both counters, across the wrap; the first frame is good whatever its counter."""
    for spec, most, lasts in (
        *((PRESSURE, 4, (last,)) for last in (0, 1, 100, 252, 253, 254, 255)),
        *((PRESSURE_CLASSIC, most, range(16)) for most in (1, 4, 7)),
    ):
        period = profile_of(spec).counter_period
        some_lost = dict.fromkeys(range(2, most + 1), FrameCheck.OK_SOME_LOST)
        expected = {0: FrameCheck.REPEATED, 1: FrameCheck.OK} | some_lost
        for last, step in product(lasts, range(period)):
            made = E2eReceiver(spec, replace(CONFIG, max_delta=most))
            assert made.tick([frame(last, spec)]).checks == (FrameCheck.OK,)
            reception = made.tick([frame(last + step, spec, time_ns=step)])
            assert reception.checks == (expected.get(step, FrameCheck.WRONG_SEQUENCE),), (spec.name, last, step)
            assert (reception.accepted is not None) == (1 <= step <= most), (spec.name, last, step)


def test_frame_that_fails_is_an_error_and_changes_no_counter():
    """A secured message is checked in full length only; what stands behind the protected part is not E2E's."""
    secured = frame(10, PRESSURE_SECURED)
    for spec, failing in (
        (PRESSURE, frame(10, good=False)),
        (PRESSURE, replace(frame(10), data=frame(10).data[:8])),
        (PRESSURE, replace(frame(10), data=b"")),
        (PRESSURE, replace(frame(10), data=PROFILE_5.protect(bytes(16), data_id=JET_COMMAND.data_id, counter=10))),
        (PRESSURE_SECURED, replace(secured, data=secured.data[: PRESSURE_SECURED.protected])),
    ):
        made = valid_receiver(spec)
        reception = made.tick([failing])
        assert (reception.checks, reception.accepted) == ((FrameCheck.ERROR,), None), failing
        assert made.state.last_counter == 9, failing
    behind = replace(secured, data=secured.data[:16] + b"\xff" * 16)
    assert valid_receiver(PRESSURE_SECURED).tick([behind]).accepted == behind
    # An extended identifier of the same number is another message's.
    assert valid_receiver().tick([replace(frame(10), is_extended=True)]).checks == (FrameCheck.NO_NEW_DATA,)


def test_several_frames_in_a_period_are_all_checked_and_the_newest_good_one_counts():
    made = valid_receiver()
    reception = made.tick([frame(10), frame(11, time_ns=1), frame(11, time_ns=2), frame(12, good=False)])
    assert reception.checks == (FrameCheck.OK, FrameCheck.OK, FrameCheck.REPEATED, FrameCheck.ERROR)
    assert reception.live == frame(11, time_ns=1)
    # Rejected are periods with frames of which none was good.
    made = valid_receiver()
    for frames in ([frame(10, good=False)], [frame(10), frame(10)], [], [frame(12)], [frame(50)]):
        made.tick(frames)
    assert (made.state.frames_rejected, made.state.count(FrameCheck.ERROR)) == (3, 1)


def test_silence_and_failing_frames_begin_no_stream():
    made = E2eReceiver(PRESSURE, CONFIG)
    assert all(made.tick(frames).stream is NODATA for frames in ([], [frame(1, good=False)]))


def test_sender_and_receiver_agree_over_several_wraps():
    made, sender = E2eReceiver(PRESSURE, CONFIG), E2eSender(PRESSURE)
    for step in range(600):
        sent = sender.frame(bytes(PRESSURE.length), now_ns=step)
        assert (sent.timestamp_ns, sent.is_fd, sent.frame_id) == (step, True, PRESSURE.frame_id)
        assert made.tick([sent]).checks == (FrameCheck.OK,)
    assert sender.state == SenderState(counter=600 % 256)
