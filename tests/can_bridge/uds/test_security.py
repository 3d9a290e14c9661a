"""Security access: seeds, wrong attempts and the delay after them; `test_pdx` computes answers by another library."""

import pytest
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

from can_bridge.flashing.state import Level
from can_bridge.uds.services import Nrc, Session
from tests.can_bridge.uds.scripted_ecu import MS, Bench, S, ScriptedEcu, refused

WRONG = b"\x5a" * 16


def cmac(key: bytes, message: bytes) -> bytes:
    """The answer by the library; `tests/can_bridge/secoc/test_key.py` has the published answers of our own."""
    made = CMAC(AES(key))
    made.update(message)
    return made.finalize()


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.ask(0x10, Session.PROGRAMMING)
    return bench


def try_wrong(bench: Bench) -> bytes | None:
    bench.seed()
    return bench.ask(0x27, 2, WRONG)


def keep_alive(bench: Bench, nanoseconds: int) -> None:
    end_ns = bench.now_ns + nanoseconds
    while bench.now_ns < end_ns:
        bench.wait(min(2 * S, end_ns - bench.now_ns))
        assert bench.ask(0x3E, 0x80) is None


def test_a_seed_of_zeros_says_that_the_level_is_unlocked(bench):
    bench.seeds = [bytes(16)]
    bench.talk("27 01 > CONDITIONS_NOT_CORRECT")
    bench.unlock()
    bench.talk("27 01 > 67 01" + 16 * " 00")
    assert bench.ask(0x27, 2, bench.key.answer(Level.PROGRAMMING, bytes(16))) == refused(0x27, Nrc.SEQUENCE_ERROR)
    assert bench.server.unlocked is Level.PROGRAMMING


def test_wrong_key_three_times_and_then_the_delay(bench):
    for code in (Nrc.INVALID_KEY, Nrc.INVALID_KEY, Nrc.EXCEEDED_ATTEMPTS):
        assert try_wrong(bench) == refused(0x27, code)
    assert bench.server.unlocked is None
    for waits_ns in (10 * S - MS, MS):
        bench.talk("27 01 > DELAY_NOT_EXPIRED")
        keep_alive(bench, waits_ns)
    # Each further wrong key brings the delay again.
    for count in (4, 5):
        assert try_wrong(bench) == refused(0x27, Nrc.EXCEEDED_ATTEMPTS)
        assert bench.ecu.attempts[Level.PROGRAMMING] == count
        # Levels have delays of their own, which outlive the session.
        bench.unlock(Level.CALIBRATION)
        bench.talk("10 02 > ok\n27 01 > DELAY_NOT_EXPIRED")
        keep_alive(bench, 10 * S)
    bench.unlock()
    assert bench.ecu.attempts[Level.PROGRAMMING] == 0
    bench.ask(0x10, Session.PROGRAMMING)
    assert try_wrong(bench) == refused(0x27, Nrc.INVALID_KEY)


def test_a_seed_is_good_for_one_answer_of_its_level_in_its_session(bench):
    def answer_to(seed: bytes, level: Level = Level.PROGRAMMING) -> bytes | None:
        return bench.ask(0x27, 2, bench.key.answer(level, seed))

    wrong, out_of_order = refused(0x27, Nrc.INVALID_KEY), refused(0x27, Nrc.SEQUENCE_ERROR)
    first, second = bench.seed(), bench.seed()
    assert first != second
    assert (answer_to(first), answer_to(second)) == (wrong, out_of_order)
    assert answer_to(bench.seed(), Level.CALIBRATION) == wrong
    seed = bench.seed()
    bench.ask(0x10, Session.PROGRAMMING)
    assert answer_to(seed) == out_of_order


def test_attempt_is_kept_before_it_is_judged(bench):
    """A supply that is cut when the answer is seen to be wrong must not save the attempt."""
    bench.ecu.refusals["keep"] = Nrc.PROGRAMMING_FAILURE
    assert try_wrong(bench) == refused(0x27, Nrc.PROGRAMMING_FAILURE)
    assert bench.ecu.calls[-1] == ("keep", Level.PROGRAMMING, 1)
    # A memory that counts no attempts unlocks nothing.
    right = bench.key.answer(Level.PROGRAMMING, bench.seed())
    assert bench.ask(0x27, 2, right) == refused(0x27, Nrc.PROGRAMMING_FAILURE)
    assert bench.server.unlocked is None


def test_attempts_before_power_on_count():
    ecu = ScriptedEcu()
    ecu.attempts[Level.PROGRAMMING] = 3
    bench = Bench(ecu, now_ns=77 * S)
    bench.talk("10 02 > ok\n27 01 > DELAY_NOT_EXPIRED")
    keep_alive(bench, 10 * S)
    bench.unlock()
    ecu.attempts[Level.PROGRAMMING] = 2
    bench = Bench(ecu)
    bench.ask(0x10, Session.PROGRAMMING)
    assert try_wrong(bench) == refused(0x27, Nrc.EXCEEDED_ATTEMPTS)
    assert ecu.attempts[Level.PROGRAMMING] == 3
