"""The tester's steps against the real server in virtual time, with everything that can go wrong on the way."""

import hashlib
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.flashing.state import Phase
from can_bridge.flashing.verdicts import Verdict
from can_bridge.tester.messages import (
    AccessError,
    ImageRefusedError,
    LostError,
    NoAnswerError,
    NotNowError,
    NotPassedError,
    RefusedError,
)
from can_bridge.tester.sequence import End, Flashed, Options, Step
from can_bridge.uds.access_key import AccessKey
from can_bridge.uds.services import Nrc, Routine, Service
from tests.can_bridge.tester.line import Line, VirtualTime, flash_over
from tests.can_bridge.tester.played_ecu import SHIPPED, Held, Played, PlayedEcu, played
from tests.examples import examples

SHA256 = hashlib.sha256(SHIPPED).digest()
WRONG_KEY = AccessKey(bytes(16 * [9]))


def fresh() -> tuple[Line, Played]:
    kept = played()
    return Line(PlayedEcu(kept)), kept


def flashed(line: Line, image: bytes = SHIPPED, **options: Any) -> Flashed:
    return flash_over(line, image, **options)


def test_a_release_is_brought_started_tested_and_confirmed(line: Line, kept: Played) -> None:
    steps: list[Step] = []
    progress: list[tuple[int, int]] = []
    done = flashed(line, on_step=steps.append, progress=lambda *count: progress.append(count))
    assert (done.end, done.unanswered) == (End.CONFIRMED, 0)
    assert (kept.running.image, kept.running.phase, kept.resets) == (SHIPPED, Phase.CONFIRMED, 1)
    assert [routine.name for routine in kept.log] == [
        *("PRECONDITIONS", "ERASE", "CHECK", "ACTIVATE", "SELF_TEST", "CONFIRM")
    ]
    assert steps == list(Step)
    assert (progress[0], progress[-1]) == ((0, len(SHIPPED)), (len(SHIPPED), len(SHIPPED)))
    assert done.after.running is not None
    # Blocks as long as the server takes them.
    blocks = [len(request) for request in line.heard if request[0] == Service.TRANSFER]
    assert (max(blocks), len(blocks)) == (4064 + 2, -(-len(SHIPPED) // 4064))


def test_counters_of_blocks_wrap_to_zero(line: Line) -> None:
    with pytest.raises(NotPassedError):  # bytes that are no bundle have no digest that could be found running
        flashed(line, bytes(4064 * 260))
    counters = [request[1] for request in line.heard if request[0] == Service.TRANSFER]
    assert counters == [i % 256 for i in range(1, 261)]


def test_it_goes_on_with_what_the_ecu_has(line: Line, kept: Played) -> None:
    """Confirmed and running, running on trial, another one on trial, no release, whole in the other slot."""
    kept.running = Held(image=SHIPPED, phase=Phase.CONFIRMED, name="same")
    assert flashed(line).end is End.ALREADY
    assert (kept.written, kept.resets, kept.log) == (0, 0, [])
    line, kept = fresh()
    kept.running = Held(image=SHIPPED, phase=Phase.TRIAL, boots_left=1, name="same")
    done = flashed(line)
    assert (done.end, done.transferred, kept.resets) == (End.CONFIRMED, None, 0)
    assert kept.log == [Routine.PRECONDITIONS, Routine.SELF_TEST, Routine.CONFIRM]
    for running in (Held(image=SHIPPED[:50], phase=Phase.TRIAL, name="other"), Held()):
        line, kept = fresh()
        kept.running = running
        assert flashed(line).end is End.CONFIRMED
        assert (Routine.ERASE in kept.log, kept.running.image) == (True, SHIPPED)


def test_an_interrupted_transfer_goes_on_where_it_stood() -> None:
    for had in (1, 31, 32, 5000, len(SHIPPED) - 1, len(SHIPPED)):
        line, kept = fresh()
        phase = Phase.FILLING if had < len(SHIPPED) else Phase.CHECKED
        kept.other = Held(image=SHIPPED[:had], announced=(len(SHIPPED), SHA256), phase=phase)
        done = flashed(line)
        assert (done.end, kept.written) == (End.CONFIRMED, len(SHIPPED) - had), had
        assert done.transferred is not None and done.transferred.resumed_from == had


def test_a_dry_run_and_a_judge_that_objects_write_nothing(line: Line, kept: Played) -> None:
    assert flashed(line, options=Options(dry_run=True)).end is End.WOULD_FLASH
    assert kept.log == [Routine.PRECONDITIONS]
    assert {request[0] for request in line.heard} <= {Service.READ, Service.SESSION, Service.ROUTINE}
    assert [request for request in line.heard if request[0] == Service.SESSION] == [b"\x10\x03", b"\x10\x01"]

    def judge(_facts: object) -> None:
        raise NotNowError("not this one")

    with pytest.raises(NotNowError, match="not this one"):
        flashed(line, judge=judge)
    assert kept.log == [Routine.PRECONDITIONS]


def test_wrong_keys_write_nothing_and_their_delay_is_waited_for(line: Line, kept: Played, time: VirtualTime) -> None:
    for words in (2 * ["it is not its own"]) + ["takes none for 10 s"]:
        with pytest.raises(AccessError, match=words):
            flashed(line, key=WRONG_KEY)
    assert set(kept.log) == {Routine.PRECONDITIONS}
    assert kept.running.phase == Phase.CONFIRMED
    began = time.clock()
    assert flashed(line).end is End.CONFIRMED
    assert time.clock() - began >= 9.0


def test_a_seed_that_comes_late_does_not_pass_for_a_wrong_key(line: Line) -> None:
    late: list[bytes] = []

    def lose(payload: bytes, to_ecu: bool) -> bool:
        if not late and payload[:2] == b"\x67\x01":
            late.append(payload)
            return True
        if to_ecu and payload == b"\x27\x01" and len(late) == 1:
            # The ECU has given another one by then.
            line.arrive(late[0])
            late.append(b"")
        return False

    line.lose = lose
    assert flashed(line).end is End.CONFIRMED
    assert len(late) == 2


def test_a_vehicle_in_use_is_not_touched(line: Line, kept: Played) -> None:
    kept.in_use = True
    with pytest.raises(NotNowError, match="withdraw the enable request"):
        flashed(line)
    assert (kept.written, kept.resets) == (0, 0)
    kept.in_use = False

    def on_step(step: Step) -> None:
        kept.in_use = step in (Step.RESET, Step.SELF_TEST)

    # One that starts after the reset leaves the release on trial.
    with pytest.raises(NotNowError, match="runs on trial, and was not confirmed"):
        flashed(line, on_step=on_step)
    assert kept.running.phase == Phase.TRIAL
    kept.in_use = False
    assert flashed(line).end is End.CONFIRMED


def test_each_verdict_ends_it_and_the_ecu_goes_back_to_work() -> None:
    for verdict in set(Verdict) - {Verdict.GOOD}:
        line, kept = fresh()
        kept.verdict = verdict
        with pytest.raises(ImageRefusedError) as refusal:
            flashed(line)
        assert refusal.value.verdict is verdict
        assert verdict.in_words in str(refusal.value)
        assert Routine.ACTIVATE not in kept.log, verdict
        line.time.sleep(1.0)
        assert (kept.resets, kept.running.name) == (1, "old"), verdict


def test_a_release_that_does_not_pass_its_trial_is_left(line: Line, kept: Played) -> None:
    kept.starts = False
    with pytest.raises(NotPassedError, match="did not start the new release; old runs"):
        flashed(line)
    line, kept = fresh()
    kept.passes = False
    with pytest.raises(NotPassedError, match="did not pass its self-test; old runs again"):
        flashed(line)
    assert kept.running.name == "old"
    assert Routine.CONFIRM not in kept.log and kept.log[-1] is Routine.REVERT


def test_an_ecu_that_resets_itself_or_is_slow_is_gone_on_with(line: Line, kept: Played) -> None:
    kept.resets_after = 40_000
    kept.writing_ns = 3_000_000_000
    done = flashed(line)
    assert done.end is End.CONFIRMED
    assert done.transferred is not None and done.transferred.attempts == 2
    assert kept.written == len(SHIPPED)


def test_a_block_refused_once_begins_the_transfer_again() -> None:
    def refused_once(code: Nrc) -> tuple[Flashed, Played]:
        line, kept = fresh()
        refused: list[bytes] = []

        def lose(payload: bytes, to_ecu: bool) -> bool:
            is_now = to_ecu and payload[:2] == bytes([Service.TRANSFER, 3]) and not refused
            if is_now:
                refused.append(payload)
                line.arrive(bytes([0x7F, Service.TRANSFER, code]))
            return is_now

        line.lose = lose
        return flashed(line), kept

    for code in (
        *(Nrc.WRONG_BLOCK_COUNTER, Nrc.TRANSFER_SUSPENDED, Nrc.SEQUENCE_ERROR, Nrc.SECURITY_ACCESS_DENIED),
        *(Nrc.SERVICE_NOT_IN_SESSION, Nrc.PROGRAMMING_FAILURE),
    ):
        done, kept = refused_once(code)
        assert done.end is End.CONFIRMED, code
        assert done.transferred is not None and done.transferred.attempts == 2, code
        assert kept.written == len(SHIPPED), code
    with pytest.raises(RefusedError, match=r"take a block of the image: service not supported \(0x11\)"):
        refused_once(Nrc.SERVICE_NOT_SUPPORTED)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1), rate=st.sampled_from([0.01, 0.1, 0.3]), doubled=st.booleans())
@examples(15, deadline=None)
def test_lost_and_doubled_payloads_only_cost_time(seed: int, rate: float, doubled: bool) -> None:
    line, kept = fresh()
    # Thousands of draws: more than a strategy gives without complaint.
    draws = Random(seed)
    line.lose = lambda payload, to_ecu: draws.random() < rate
    line.double = doubled
    try:
        flashed(line)
    except (NoAnswerError, LostError, NotPassedError):
        # It may end, but never with a release that is neither the old nor the new one.
        assert kept.running.name in ("old", "")
    assert kept.running.image in (SHIPPED, SHIPPED[:100])
