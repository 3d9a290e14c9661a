"""The tester's steps against the real server in virtual time, with everything that can go wrong on the way."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from random import Random
from typing import Any

import pytest
from hypothesis import HealthCheck, given
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
from can_bridge.tester.sequence import End, Flashed, Step
from can_bridge.uds.services import Nrc, Routine, Service
from tests.can_bridge.tester.conftest import SHIPPED
from tests.can_bridge.tester.played_ecu import Held, Line, Played, VirtualTime
from tests.examples import examples

Call = Callable[..., Flashed]
SHA256 = hashlib.sha256(SHIPPED).digest()


def test_a_release_is_brought_started_tested_and_confirmed(flashing: Call, kept: Played, line: Line) -> None:
    steps: list[Step] = []
    told: list[tuple[int, int]] = []
    flashed = flashing(say=steps.append, progress=lambda *count: told.append(count))
    assert flashed.end is End.CONFIRMED
    assert kept.running.image == SHIPPED
    assert kept.running.phase == Phase.CONFIRMED
    assert kept.resets == 1
    assert kept.log == [
        *(Routine.PRECONDITIONS, Routine.ERASE, Routine.CHECK, Routine.ACTIVATE, Routine.SELF_TEST, Routine.CONFIRM)
    ]
    assert steps == [
        *(Step.IDENTIFY, Step.PRECONDITIONS, Step.TRANSFER, Step.ACTIVATE, Step.RESET, Step.SELF_TEST, Step.CONFIRM)
    ]
    assert told[0] == (0, len(SHIPPED))
    assert told[-1] == (len(SHIPPED), len(SHIPPED))
    assert flashed.unanswered == 0
    assert flashed.after.running is not None
    # Blocks as long as the server takes them.
    blocks = [len(request) for request in line.heard if request[0] == Service.TRANSFER]
    assert max(blocks) == 4064 + 2
    assert len(blocks) == -(-len(SHIPPED) // 4064)


def test_counters_of_blocks_wrap_to_zero(flashing: Call, line: Line) -> None:
    image = bytes(4064 * 260)
    with pytest.raises(NotPassedError):  # bytes that are no bundle have no digest that could be found running
        flashing(image)
    counters = [request[1] for request in line.heard if request[0] == Service.TRANSFER]
    assert counters == [i % 256 for i in range(1, 261)]


def test_what_runs_and_is_confirmed_is_left_alone(flashing: Call, kept: Played, line: Line) -> None:
    kept.running = Held(image=SHIPPED, phase=Phase.CONFIRMED, name="same")
    assert flashing().end is End.ALREADY
    assert kept.written == kept.resets == 0
    assert kept.log == []


def test_what_runs_on_trial_is_tested_and_confirmed(flashing: Call, kept: Played) -> None:
    kept.running = Held(image=SHIPPED, phase=Phase.TRIAL, boots_left=1, name="same")
    flashed = flashing()
    assert flashed.end is End.CONFIRMED
    assert flashed.transferred is None
    assert kept.log == [Routine.PRECONDITIONS, Routine.SELF_TEST, Routine.CONFIRM]
    assert kept.resets == 0


def test_another_release_on_trial_is_written_over(flashing: Call, kept: Played) -> None:
    kept.running = Held(image=SHIPPED[:50], phase=Phase.TRIAL, name="other")
    assert flashing().end is End.CONFIRMED
    assert Routine.ERASE in kept.log
    assert kept.running.image == SHIPPED


def test_an_ecu_without_a_release_is_flashed(flashing: Call, kept: Played) -> None:
    kept.running = Held()
    assert flashing().end is End.CONFIRMED
    assert kept.running.image == SHIPPED


def test_an_image_that_is_there_as_a_whole_is_only_checked(flashing: Call, kept: Played) -> None:
    kept.other = Held(image=SHIPPED, announced=(len(SHIPPED), SHA256), phase=Phase.CHECKED)
    flashed = flashing()
    assert flashed.end is End.CONFIRMED
    assert flashed.transferred is not None
    assert flashed.transferred.resumed_from == len(SHIPPED)
    assert kept.written == 0


@pytest.mark.parametrize("had", [1, 31, 32, 5000, len(SHIPPED) - 1])
def test_an_interrupted_transfer_goes_on_where_it_stood(flashing: Call, kept: Played, had: int) -> None:
    kept.other = Held(image=SHIPPED[:had], announced=(len(SHIPPED), SHA256), phase=Phase.FILLING)
    flashed = flashing()
    assert flashed.end is End.CONFIRMED
    assert kept.written == len(SHIPPED) - had
    assert flashed.transferred is not None
    assert flashed.transferred.resumed_from == had


def test_a_dry_run_writes_nothing(flashing: Call, kept: Played, line: Line) -> None:
    assert flashing(dry_run=True).end is End.WOULD_FLASH
    assert kept.log == [Routine.PRECONDITIONS]
    sent = {request[0] for request in line.heard}
    assert sent <= {Service.READ, Service.SESSION, Service.ROUTINE}
    assert [request for request in line.heard if request[0] == Service.SESSION] == [b"\x10\x03", b"\x10\x01"]


def test_without_confirmation_it_stays_on_trial(flashing: Call, kept: Played) -> None:
    assert flashing(confirm=False).end is End.ON_TRIAL
    assert kept.running.phase == Phase.TRIAL
    assert Routine.SELF_TEST in kept.log


def test_a_judge_stops_it_before_anything_is_written(flashing: Call, kept: Played) -> None:
    def judge(_facts: object) -> None:
        raise NotNowError("not this one")

    with pytest.raises(NotNowError, match="not this one"):
        flashing(judge=judge)
    assert kept.log == []


def test_a_wrong_key_is_refused_and_nothing_written(flashing: Call, kept: Played) -> None:
    with pytest.raises(AccessError, match="it is not its own"):
        flashing(secret=bytes(16 * [9]))
    assert kept.log == [Routine.PRECONDITIONS]
    # The ECU is not kept from its work.
    assert kept.running.phase == Phase.CONFIRMED


def test_the_third_wrong_key_says_how_long_to_wait(flashing: Call) -> None:
    for _ in range(2):
        with pytest.raises(AccessError, match="it is not its own"):
            flashing(secret=bytes(16 * [9]))
    with pytest.raises(AccessError, match="takes none for 10 s"):
        flashing(secret=bytes(16 * [9]))


def test_the_delay_after_wrong_keys_is_waited_for(flashing: Call, kept: Played, time: VirtualTime) -> None:
    for _ in range(3):
        with pytest.raises(AccessError):
            flashing(secret=bytes(16 * [9]))
    began = time.clock()
    assert flashing().end is End.CONFIRMED
    assert time.clock() - began >= 9.0


def test_a_seed_that_comes_late_does_not_pass_for_a_wrong_key(flashing: Call, line: Line) -> None:
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
    assert flashing().end is End.CONFIRMED
    assert len(late) == 2


def test_a_vehicle_in_use_is_not_touched(flashing: Call, kept: Played) -> None:
    kept.in_use = True
    with pytest.raises(NotNowError, match="withdraw the enable request"):
        flashing()
    assert kept.written == 0
    assert kept.resets == 0


def test_a_vehicle_that_starts_after_the_reset_leaves_it_on_trial(flashing: Call, kept: Played) -> None:
    def say(step: Step) -> None:
        kept.in_use = step in (Step.RESET, Step.SELF_TEST)

    with pytest.raises(NotNowError, match="runs on trial, and was not confirmed"):
        flashing(say=say)
    assert kept.running.phase == Phase.TRIAL
    kept.in_use = False
    assert flashing().end is End.CONFIRMED


@pytest.mark.parametrize("verdict", [verdict for verdict in Verdict if verdict is not Verdict.GOOD])
def test_each_verdict_ends_it_and_the_ecu_goes_back_to_work(
    flashing: Call, kept: Played, time: VirtualTime, verdict: Verdict
) -> None:
    kept.verdict = verdict
    with pytest.raises(ImageRefusedError) as caught:
        flashing()
    assert caught.value.verdict is verdict
    assert verdict.in_words in str(caught.value)
    assert Routine.ACTIVATE not in kept.log
    time.sleep(1.0)
    assert kept.resets == 1
    assert kept.running.name == "old"


def test_a_release_that_does_not_start_is_told(flashing: Call, kept: Played) -> None:
    kept.starts = False
    with pytest.raises(NotPassedError, match="did not start the new release; old runs"):
        flashing()


def test_a_failed_self_test_goes_back(flashing: Call, kept: Played) -> None:
    kept.passes = False
    with pytest.raises(NotPassedError, match="did not pass its self-test; old runs again"):
        flashing()
    assert kept.running.name == "old"
    assert Routine.CONFIRM not in kept.log
    assert kept.log[-1] is Routine.REVERT


def test_no_ecu_is_told_within_seconds(flashing: Call, kept: Played, time: VirtualTime) -> None:
    kept.is_dead = True
    with pytest.raises(NoAnswerError, match="see that it has power"):
        flashing()
    assert time.clock() < 5.0


def test_an_ecu_that_falls_silent_is_gone_on_with_later(flashing: Call, kept: Played) -> None:
    kept.dead_after = 40_000
    with pytest.raises(LostError, match=f"of {len(SHIPPED)} bytes .* the same command goes on from there"):
        flashing()
    kept.is_dead, kept.dead_after = False, None
    flashed = flashing()
    assert flashed.transferred is not None
    assert flashed.transferred.resumed_from >= 40_000
    assert kept.written == len(SHIPPED)


def test_an_ecu_that_resets_itself_is_gone_on_with(flashing: Call, kept: Played) -> None:
    kept.resets_after = 40_000
    flashed = flashing()
    assert flashed.end is End.CONFIRMED
    assert flashed.transferred is not None
    assert flashed.transferred.attempts == 2
    assert kept.written == len(SHIPPED)


@pytest.mark.parametrize(
    "code",
    [
        *(Nrc.WRONG_BLOCK_COUNTER, Nrc.TRANSFER_SUSPENDED, Nrc.SEQUENCE_ERROR, Nrc.SECURITY_ACCESS_DENIED),
        *(Nrc.SERVICE_NOT_IN_SESSION, Nrc.PROGRAMMING_FAILURE),
    ],
)
def test_a_block_refused_once_begins_the_transfer_anew(flashing: Call, kept: Played, line: Line, code: Nrc) -> None:
    flashed, refused = _refused_once(flashing, line, code)
    assert refused
    assert flashed.end is End.CONFIRMED
    assert flashed.transferred is not None
    assert flashed.transferred.attempts == 2
    assert kept.written == len(SHIPPED)


def test_another_refusal_ends_it_at_once(flashing: Call, kept: Played, line: Line) -> None:
    with pytest.raises(RefusedError, match=r"take a block of the image: service not supported \(0x11\)"):
        _refused_once(flashing, line, Nrc.SERVICE_NOT_SUPPORTED)
    assert kept.running.name == "old"


def _refused_once(flashing: Call, line: Line, code: Nrc) -> tuple[Flashed, list[bytes]]:
    """With the third block refused by this code, and lost."""
    refused: list[bytes] = []

    def lose(payload: bytes, to_ecu: bool) -> bool:
        is_now = to_ecu and payload[:2] == bytes([Service.TRANSFER, 3]) and not refused
        if is_now:
            refused.append(payload)
            line.arrive(bytes([0x7F, Service.TRANSFER, code]))
        return is_now

    line.lose = lose
    return flashing(), refused


def test_slow_memory_is_waited_for(flashing: Call, kept: Played) -> None:
    kept.writing_ns = 3_000_000_000
    assert flashing().end is End.CONFIRMED
    assert kept.written == len(SHIPPED)


def test_a_memory_that_fails_is_given_up(flashing: Call, kept: Played, monkeypatch: pytest.MonkeyPatch) -> None:
    from can_bridge.uds.refused import Refused
    from tests.can_bridge.tester.played_ecu import PlayedEcu

    def fails(_ecu: PlayedEcu, _data: bytes) -> Any:
        raise Refused(Nrc.PROGRAMMING_FAILURE)

    monkeypatch.setattr(PlayedEcu, "transfer", fails)
    with pytest.raises(RefusedError, match=r"take a block of the image: programming failure \(0x72\)"):
        flashing()
    assert kept.running.name == "old"


def test_any_one_request_or_answer_may_be_lost(flashing: Call, kept: Played, line: Line) -> None:
    """Each in turn: whatever of the sequence is not answered is asked again, and nothing is written twice."""
    flashing()
    for lost in range(len(line.heard)):
        for to_ecu in (True, False):
            again = replace(kept, running=_old(), other=Held(), written=0, resets=0, log=[])
            time = VirtualTime()
            its = Line(again, time)
            its.lose = _loses(lost, to_ecu=to_ecu)
            _flash(its, time)
            assert again.running.image == SHIPPED, (lost, to_ecu)
            assert again.running.phase == Phase.CONFIRMED
            assert again.written == len(SHIPPED)
            # A trial has three boots.
            assert again.resets <= 2


def _loses(number: int, *, to_ecu: bool) -> Callable[[bytes, bool], bool]:
    """Loses one payload in one direction."""
    left = [number]

    def lose(_payload: bytes, is_request: bool) -> bool:
        left[0] -= is_request is to_ecu
        return is_request is to_ecu and left[0] == -1

    return lose


@given(seed=st.integers(0, 2**32 - 1), rate=st.sampled_from([0.01, 0.1, 0.3]), doubled=st.booleans())
@examples(15, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_lost_and_doubled_payloads_only_cost_time(seed: int, rate: float, doubled: bool, kept: Played) -> None:
    again = replace(kept, running=_old(), other=Held(), written=0, log=[], attempts={})
    time = VirtualTime()
    line = Line(again, time)
    # Thousands of draws: more than a strategy gives without complaint.
    draws = Random(seed)
    line.lose = lambda payload, to_ecu: draws.random() < rate
    line.double = doubled
    try:
        _flash(line, time)
    except (NoAnswerError, LostError, NotPassedError):
        # It may end, but never with a release that is neither the old nor the new one.
        assert again.running.name in ("old", "")
    assert again.running.image in (SHIPPED, _old().image)


def _old() -> Held:
    return Held(image=SHIPPED[:100], announced=(100, bytes(32)), phase=Phase.CONFIRMED, name="old")


def _flash(line: Line, time: VirtualTime) -> Flashed:
    from udsoncan.client import Client

    from can_bridge.tester.sequence import flash
    from can_bridge.uds.access_key import AccessKey
    from tests.can_bridge.tester.played_ecu import SECRET

    return flash(Client(line), SHIPPED, key=AccessKey(SECRET).answer, clock=time.clock, sleep=time.sleep)
