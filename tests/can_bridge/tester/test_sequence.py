"""The tester's steps against the real server and store in virtual time, with everything that goes wrong on the way."""

import hashlib
from itertools import product
from typing import Any
from unittest.mock import Mock

import pytest

from can_bridge.flashing.backing import Slot, at_once
from can_bridge.flashing.state import SlotPhase
from can_bridge.flashing.store import Store
from can_bridge.flashing.verdicts import Verdict
from can_bridge.tester import messages
from can_bridge.tester.sequence import End, Flashed, Flashing, Step
from can_bridge.uds.security import AccessKey
from can_bridge.uds.services import SERVICES, Did, Nrc, Refused, Routine, Service
from contract.errors import FlashError
from tests.can_bridge.flashing.releases import BLOCK, damage, flash, image, phases
from tests.can_bridge.flashing.store_ecu import KEY
from tests.can_bridge.tester.ecus import EcuToFlash
from tests.can_bridge.tester.line import Line

NEW = image("new")
SHA256 = hashlib.sha256(NEW).digest()
WRONG_KEY = AccessKey(bytes(16 * [9]))


def fresh(first: bytes | None = image("old")) -> tuple[Line, EcuToFlash]:
    ecu = EcuToFlash(first)
    return Line(ecu), ecu


@pytest.fixture
def ecu() -> EcuToFlash:
    return EcuToFlash()


@pytest.fixture
def line(ecu: EcuToFlash) -> Line:
    return Line(ecu)


def flashed(line: Line, new: bytes = NEW, *, key: AccessKey = KEY, **options: Any) -> Flashed:
    return Flashing(line.asking(key), new, **options).run()


def test_an_ecu_that_knows_neither_silence_nor_a_switch_for_faults_is_flashed_all_the_same(monkeypatch) -> None:
    for is_heard in (True, False):
        line, ecu = fresh()
        line.lose = lambda payload, to_ecu: not is_heard and to_ecu and payload[0] in (0x28, 0x85)  # noqa: B023
        with monkeypatch.context() as patch:
            known = {number: who for number, who in SERVICES.items() if number not in (0x28, 0x85)}
            patch.setattr("can_bridge.uds.server.SERVICES", known)
            assert (flashed(line).end, ecu.runs) == (End.CONFIRMED, "new"), is_heard


def test_a_release_is_brought_started_tested_and_confirmed(line: Line, ecu: EcuToFlash) -> None:
    steps: list[Step] = []
    progress: list[tuple[int, int]] = []
    done = flashed(line, on_step=steps.append, progress=lambda *count: progress.append(count))
    assert (done.end, done.unanswered, done.after.running) == (End.CONFIRMED, 0, Slot.B)
    assert (ecu.runs, ecu.memory.content(Slot.B), ecu.resets) == ("new", NEW, 1)
    assert [routine.name for routine in ecu.routines] == [
        *("PRECONDITIONS", "ERASE", "CHECK", "ACTIVATE", "SELF_TEST", "CONFIRM")
    ]
    assert steps == list(Step)
    assert (progress[0], progress[-1]) == ((0, len(NEW)), (len(NEW), len(NEW)))
    # Blocks as long as the server takes them.
    blocks = [len(request) for request in line.heard if request[0] == Service.TRANSFER]
    assert (max(blocks), len(blocks)) == (4064 + 2, -(-len(NEW) // 4064))
    # In the order of ISO 14229-1: faults off and silence in the extended session, then the programming session.
    order = [line.heard.index(bytes.fromhex(request)) for request in ("1003", "31010203", "8502", "280101", "1002")]
    assert order == sorted(order)
    # The same one again, and others.
    for name, end in (("new", End.ALREADY), ("two", End.CONFIRMED), ("new", End.CONFIRMED)):
        ecu.routines.clear()
        assert (flashed(line, image(name)).end, ecu.runs) == (end, name)
        assert (ecu.routines == []) is (end is End.ALREADY)


def test_counters_of_blocks_wrap_to_zero(line: Line, ecu: EcuToFlash) -> None:
    ecu.memory.capacity = 2**21
    with pytest.raises(messages.ImageRefusedError):
        flashed(line, bytes(4064 * 260))
    counters = [request[1] for request in line.heard if request[0] == Service.TRANSFER]
    assert counters == [i % 256 for i in range(1, 261)]


def test_it_goes_on_with_what_the_ecu_has(line: Line, ecu: EcuToFlash) -> None:
    """Running on trial, another one on trial, no release, and some or all of it in the other slot."""
    assert flashed(line, confirm=False).end is End.ON_TRIAL
    done = flashed(line)
    assert (done.end, done.resumed_from, ecu.resets) == (End.CONFIRMED, None, 1)
    assert ecu.routines[-3:] == [Routine.PRECONDITIONS, Routine.SELF_TEST, Routine.CONFIRM]
    line, ecu = fresh()
    flash(ecu.store, image("other"))
    ecu.power_on()
    assert (ecu.runs, flashed(line).end, ecu.runs) == ("other", End.CONFIRMED, "new")
    line, ecu = fresh(None)
    assert (flashed(line).end, ecu.runs) == (End.CONFIRMED, "new")
    for had in (1, 31, 32, BLOCK, len(NEW) - 1, len(NEW)):
        line, ecu = fresh()
        at_once(ecu.store.announce(len(NEW), SHA256))
        ecu.store.append(NEW[:had])
        ecu.memory.written = 0
        done = flashed(line)
        assert (done.end, done.resumed_from, ecu.memory.written) == (End.CONFIRMED, had, len(NEW) - had)


def test_a_dry_run_writes_nothing(line: Line, ecu: EcuToFlash) -> None:
    calls = ecu.memory.calls
    assert flashed(line, dry_run=True).end is End.WOULD_FLASH
    assert {request[0] for request in line.heard} <= {Service.READ, Service.SESSION, Service.ROUTINE}
    assert [request for request in line.heard if request[0] == Service.SESSION] == [b"\x10\x03", b"\x10\x01"]
    assert (ecu.routines, ecu.memory.calls) == ([Routine.PRECONDITIONS], calls)


def test_an_ecu_that_means_something_else_by_an_identifier_is_not_flashed(line: Line, ecu: EcuToFlash) -> None:
    calls = ecu.memory.calls
    # So large a number is neither a float nor a string of Python.
    ecu.values[Did.PERIOD_NS] = b"\x01" + bytes(4000)
    with pytest.raises(FlashError, match="period_ns has 4001 bytes, must have 8"):
        flashed(line)
    assert ecu.memory.calls == calls


def test_wrong_keys_write_nothing_and_their_delay_is_waited_for(line: Line, ecu: EcuToFlash) -> None:
    for words in (2 * ["it must be the ECU's"]) + ["accepts no key for 10 s"]:
        with pytest.raises(messages.AccessError, match=words):
            flashed(line, key=WRONG_KEY)
    assert set(ecu.routines) == {Routine.PRECONDITIONS}
    began = line.clock()
    assert flashed(line).end is End.CONFIRMED
    assert line.clock() - began >= 9.0


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
    assert (flashed(line).end, len(late)) == (End.CONFIRMED, 2)


def test_a_vehicle_in_use_is_not_touched(line: Line, ecu: EcuToFlash) -> None:
    ecu.is_wanted = True
    with pytest.raises(messages.NotNowError, match="withdraw the enable request"):
        flashed(line)
    assert (ecu.memory.written, ecu.resets) == (0, 0)
    ecu.is_wanted = False

    def on_step(step: Step) -> None:
        ecu.is_wanted = step in (Step.RESET, Step.SELF_TEST)

    # One that starts after the reset leaves the release on trial.
    with pytest.raises(messages.NotNowError, match="runs on trial, and was not confirmed"):
        flashed(line, on_step=on_step)
    assert (ecu.runs, phases(ecu.store)) == ("new", [SlotPhase.CONFIRMED, SlotPhase.TRIAL])
    ecu.is_wanted = False
    assert flashed(line).end is End.CONFIRMED


def test_each_verdict_ends_it_and_the_ecu_goes_back_to_work(monkeypatch: pytest.MonkeyPatch) -> None:
    def finish(verdict: Verdict) -> Any:
        yield
        return verdict

    for verdict in set(Verdict) - {Verdict.GOOD}:
        line, ecu = fresh()
        with monkeypatch.context() as patch, pytest.raises(messages.ImageRefusedError) as refusal:
            patch.setattr(Store, "finish", lambda store, verdict=verdict: finish(verdict))
            flashed(line)
        assert refusal.value.verdict is verdict and verdict.in_words in str(refusal.value)
        line.sleep(1.0)
        assert (Routine.ACTIVATE in ecu.routines, ecu.resets, ecu.runs) == (False, 1, "old"), verdict


def test_a_release_that_does_not_pass_its_trial_is_left(line: Line, ecu: EcuToFlash, monkeypatch: Any) -> None:
    with pytest.raises(messages.NotPassedError, match="did not start the new release; old runs"):
        flashed(line, on_step=lambda step: damage(ecu.memory, Slot.B) if step is Step.RESET else None)
    line, ecu = fresh()
    monkeypatch.setattr(ecu, "self_test", Mock(side_effect=Refused(Nrc.PROGRAMMING_FAILURE)))
    with pytest.raises(messages.NotPassedError, match="did not pass its self-test; old runs again"):
        flashed(line)
    assert (ecu.runs, ecu.routines[-2:]) == ("old", [Routine.ACTIVATE, Routine.REVERT])


def test_an_ecu_that_resets_itself_or_is_slow_is_gone_on_with(line: Line, ecu: EcuToFlash, monkeypatch: Any) -> None:
    # Erasing takes 6 s.
    monkeypatch.setattr("tests.can_bridge.flashing.plain_backing.CLEAR_PIECES", 300)

    def reset_once(received: int) -> None:
        if received > 10_000 and not ecu.resets:
            ecu.reset()

    ecu.memory.on_written = reset_once
    done = flashed(line)
    assert (done.end, done.attempts, ecu.memory.written) == (End.CONFIRMED, 2, len(NEW))
    assert line.pending >= 2


def test_a_block_refused_once_begins_the_transfer_again() -> None:
    def refused_once(code: Nrc) -> tuple[Flashed, EcuToFlash]:
        line, ecu = fresh()
        left = [bytes([0x7F, Service.TRANSFER, code])]

        def lose(payload: bytes, to_ecu: bool) -> bool:
            is_now = to_ecu and payload[:2] == bytes([Service.TRANSFER, 3]) and bool(left)
            if is_now:
                line.arrive(left.pop())
            return is_now

        line.lose = lose
        return flashed(line), ecu

    for code in (
        *(Nrc.WRONG_BLOCK_COUNTER, Nrc.TRANSFER_SUSPENDED, Nrc.SEQUENCE_ERROR, Nrc.SECURITY_ACCESS_DENIED),
        *(Nrc.SERVICE_NOT_IN_SESSION, Nrc.PROGRAMMING_FAILURE),
    ):
        done, ecu = refused_once(code)
        assert (done.end, done.attempts, ecu.memory.written) == (End.CONFIRMED, 2, len(NEW)), code
    with pytest.raises(messages.RefusedError, match=r"take a block of the image: service not supported \(0x11\)"):
        refused_once(Nrc.SERVICE_NOT_SUPPORTED)


@pytest.mark.slow
def test_a_mishap_at_any_one_request_is_overcome() -> None:
    """A lost answer, or the supply lost before or after a request was carried out; a request that is lost alone changes
    nothing, and frames that are lost or doubled only cost time, as `test_transport.py` shows."""
    whole, _ = fresh()
    flashed(whole)
    blocks, reads = (
        [number for number, request in enumerate(whole.heard) if request[0] == service]
        for service in (Service.TRANSFER, Service.READ)
    )
    # Blocks in the middle are all alike, and so are the reports before anything is done.
    numbers = set(range(len(whole.heard))) - set(blocks[2:-2]) - set(reads[2:6])
    for number, (to_ecu, loses_power) in product(numbers, ((True, True), (False, True), (False, False))):
        line, ecu = fresh()
        left = [number]

        def lose(_payload: bytes, is_to_ecu: bool) -> bool:
            is_now = left[0] == 0 and is_to_ecu is to_ecu  # noqa: B023
            left[0] -= is_now or (is_to_ecu and left[0] > 0)  # noqa: B023
            if is_now and loses_power:  # noqa: B023
                ecu.power_on()  # noqa: B023
            return is_now

        line.lose = lose
        case = (number, whole.heard[number][:4], to_ecu, loses_power)
        assert (flashed(line).end, ecu.runs) == (End.CONFIRMED, "new"), case
