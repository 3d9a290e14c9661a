"""Sessions, timing, downloads, and each negative response outside security access; for answers to any bytes see
`tests/proofs/loader_in_c/test_node.py`."""

import itertools

import pytest

from can_bridge.flashing.state import Level
from can_bridge.uds.services import LONGEST_ANSWER, MAX_BLOCK, Did, Nrc, Routine, Service, Session
from tests.can_bridge.uds.scripted_ecu import MS, Bench, S, refused, talk

CHECK = Routine.CHECK.to_bytes(2, "big")


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_services_of_each_session(bench):
    for service in set(range(256)) - set(Service):
        assert bench.ask(service, 1, 2, 3) == refused(service, Nrc.SERVICE_NOT_SUPPORTED), service
    for session, absent in (
        (Session.DEFAULT, {0x11, 0x27, 0x28, 0x2E, 0x31, 0x34, 0x36, 0x37, 0x85}),
        (Session.EXTENDED, {0x11, 0x34, 0x36, 0x37}),
        (Session.PROGRAMMING, set()),
    ):
        bench.ask(0x10, session)
        not_there = {each for each in Service if bench.ask(each) == refused(each, Nrc.SERVICE_NOT_IN_SESSION)}
        assert not_there == absent, session


REFUSED = {
    Nrc.INCORRECT_LENGTH: """
        10 100100 11 110100 3e 3e0000 22 22f1 22f18cf1 2e 2ef18c 27 270100 2702 27020000 31 3101 310102 3101020300 34
        3400 34004400 36 3601 3700 14 14ffff 14ffffff00 19 1901 19020000 190a00 1904110451 28 2800 850100""",
    # The last: at least two bytes, then the sub-function, then the whole length (ISO 14229-1).
    Nrc.SUB_FUNCTION_NOT_SUPPORTED: """
        1000 1004 1060 1100 1102 2700 2705 2706 2711 277f 3102ff00 3103ff00 3e01 1903ff 2802 2803 8500 3e0100""",
}


def test_wrong_lengths_and_sub_functions(bench):
    bench.unlock()
    for code, requests in REFUSED.items():
        for request in map(bytes.fromhex, requests.split()):
            assert bench.ask(request) == refused(request[0], code), request.hex()
    assert bench.ask(b"\x22" + 17 * b"\xf1\x8c") == refused(0x22, Nrc.INCORRECT_LENGTH)
    assert not any(bench.ecu.attempts.values()), "a request of another length is no attempt"
    # Longer than ISO-TP carries.
    bench.talk("2E FD 02 00x4092 > 6E FD 02\n2E FD 02 00x4493 > INCORRECT_LENGTH")


def test_every_change_of_session_locks_and_leaves(bench):
    bench.ask(0x10, 1)
    bench.wait(60 * S)
    assert bench.ecu.calls == [("enter", Session.DEFAULT)], "the default session is not left"
    for session in Session:
        bench.unlock()
        bench.ecu.calls.clear()
        bench.ask(0x10, session)
        assert (bench.server.unlocked, bench.ecu.calls) == (None, [("enter", session), ("leave",)]), session
    # A refused one leaves that before.
    bench.unlock()
    bench.ecu.refusals["enter"] = Nrc.CONDITIONS_NOT_CORRECT
    bench.talk("10 02 > CONDITIONS_NOT_CORRECT")
    assert (bench.server.session, bench.server.unlocked) == (Session.PROGRAMMING, Level.PROGRAMMING)


def test_silence_ends_a_session_and_any_request_keeps_it(bench):
    # P2 and P2* are 50 ms and 5 s.
    bench.talk("10 03 > 50 03 00 32 01 F4")
    bench.unlock()
    for waits_ns, session in ((5 * S - 1, Session.PROGRAMMING), (1, Session.DEFAULT)):
        bench.wait(waits_ns)
        assert bench.server.session == session
    assert (bench.server.unlocked, bench.ecu.calls[-1]) == (None, ("leave",))
    # Without a tick, too.
    bench.ask(0x10, 3)
    bench.now_ns += 5 * S
    bench.talk("31 01 02 03 > SERVICE_NOT_IN_SESSION\n10 03 > ok")
    for heard in (b"\x3e\x80", b"\x3e\x00", b"\x22\xf1\x8c", b"\x99"):
        bench.wait(4 * S)
        bench.ask(heard)
        assert bench.server.session == Session.EXTENDED, heard
    # S3 stands while a request is worked on, and begins with its answer.
    bench.unlock()
    bench.ecu.pieces = 3
    bench.talk("31 01 FF 01 > -")
    for waits_ns in (4 * S, 4 * S, 4 * S, 5 * S - 1):
        bench.wait(waits_ns)
        assert bench.server.session == Session.PROGRAMMING
    bench.wait(1)
    assert bench.server.session == Session.DEFAULT


def test_positive_answers_are_suppressed_and_negative_ones_are_not(bench):
    bench.now_ns = 100 * S
    bench.talk("10 83 > -\n3E 80 > -\n31 81 02 03 > -\n10 84 > SUB_FUNCTION_NOT_SUPPORTED")
    assert ("routine", Routine.PRECONDITIONS, b"") in bench.ecu.calls
    bench.wait(-90 * S)
    assert bench.server.session == Session.EXTENDED, "a clock that goes back ends nothing"


def test_reset_is_answered_before_it_happens(bench):
    bench.talk("10 02 > ok\n11 01 > 51 01")
    assert bench.server.is_busy and ("reset",) not in bench.ecu.calls
    bench.talk("10 01 > BUSY_REPEAT_REQUEST")
    for _ in range(2):
        assert (bench.wait(MS), bench.ecu.calls.count(("reset",))) == ([], 1)


def test_long_work_is_announced_in_time(bench):
    bench.unlock()
    bench.ecu.pieces, bench.ecu.status = 1000, b"\x05"
    start_ns, sent = bench.now_ns, list[tuple[int, bytes]]()
    bench.talk("31 01 FF 01 > -")
    while bench.server.is_busy:
        sent += [(bench.now_ns - start_ns, answer) for answer in bench.wait(10 * MS)]
    assert sent[-1] == (10 * S, b"\x71\x01" + CHECK + b"\x05")
    assert {answer for _, answer in sent[:-1]} == {refused(0x31, Nrc.RESPONSE_PENDING)}
    # P2 is 50 ms, P2* 5 s.
    assert 0 < sent[0][0] <= 50 * MS
    assert all(0 < later - earlier <= 5 * S for (earlier, _), (later, _) in itertools.pairwise(sent))


def test_suppressed_work_is_answered_only_to_who_had_to_wait(bench):
    bench.unlock()
    bench.ecu.pieces = 2
    pending = refused(0x31, Nrc.RESPONSE_PENDING)
    for waits_ns, expected in ((40 * MS, [pending, b"\x71\x01" + CHECK]), (10 * MS, [])):
        bench.talk("31 81 FF 01 > -")
        assert bench.wait(waits_ns) + bench.wait(waits_ns) == expected
        assert not bench.server.is_busy


def test_other_requests_wait_and_work_may_end_in_a_refusal(bench):
    bench.unlock()
    bench.ecu.pieces = 2
    bench.talk("31 01 FF 01 > -\n10 01 > BUSY_REPEAT_REQUEST\n3E 80 > -\n3E 00 > BUSY_REPEAT_REQUEST")
    assert bench.wait(MS) + bench.wait(MS) == [b"\x71\x01" + CHECK]
    assert bench.server.session == Session.PROGRAMMING
    bench.ecu.pieces, bench.ecu.refusals["routine"] = 1, Nrc.PROGRAMMING_FAILURE
    bench.talk("31 01 FF 01 > -")
    assert bench.wait(MS) == [refused(0x31, Nrc.PROGRAMMING_FAILURE)]


def test_reading_and_writing(bench, monkeypatch):
    # Several at once, without those that are not there.
    bench.talk(
        """
        22 F1 8C > 62 F1 8C 30 38 31 35
        22 00 00 > OUT_OF_RANGE
        22 FD 11 > OUT_OF_RANGE
        22 FF FF > OUT_OF_RANGE
        22 F1 8C 00 00 F1 91 > 62 F1 8C 30 38 31 35 F1 91 62 65 6E 63 68
        """
    )
    bench.ecu.values[Did.STORE] = bytes(4092)
    bench.talk(f"22 FD 01 > 62 FD 01 {bytes(4092).hex()}\n22 FD 01 F1 8C > RESPONSE_TOO_LONG")
    bench.ecu.values[Did.STORE] = bytes(LONGEST_ANSWER - 9)
    assert len(bench.ask(b"\x22\xfd\x01\xf1\x8c")) == LONGEST_ANSWER
    bench.ecu.values[Did.STORE] = bytes(4093)
    bench.talk("22 FD 01 > RESPONSE_TOO_LONG")
    bench.ecu.refusals["read"] = Nrc.CONDITIONS_NOT_CORRECT
    bench.talk("22 F1 8C > CONDITIONS_NOT_CORRECT")
    with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):  # an error of the ECU is not hidden
        patch.setattr(bench.ecu, "read", lambda did: 1 // 0)
        bench.ask(b"\x22\xf1\x8c")
    assert not bench.server.is_busy
    bench.unlock(Level.CALIBRATION)
    bench.talk("2E FD 12 01 > 6E FD 12")
    assert bench.ecu.calls[-1] == ("write", Did.CALIBRATION_STORED, b"\x01")
    bench.talk("2E FD 10 00x43 > INCORRECT_LENGTH\n2E FD 10 00x45 > INCORRECT_LENGTH\n2E FD 10 00x44 > 6E FD 10")
    bench.ecu.refusals["write"] = Nrc.OUT_OF_RANGE
    bench.talk("2E FD 10 00x44 > OUT_OF_RANGE")


def test_identifiers_are_written_in_their_sessions_with_their_keys(bench):
    writable = {Did.KEY_LIST: Level.PROGRAMMING}
    writable |= dict.fromkeys((Did.CALIBRATION, Did.CALIBRATION_STORED), Level.CALIBRATION)
    for level, did in itertools.product(Level, [*Did, 0x0000]):
        bench.unlock(level)
        bench.ecu.calls.clear()
        if writable.get(did) is not level:
            assert bench.ask(0x2E, did.to_bytes(2, "big"), bytes(8)) == refused(0x2E, Nrc.OUT_OF_RANGE), did
            assert bench.ecu.calls == []
            continue
        bench.ask(0x10, bench.server.session)
        assert bench.ask(0x2E, did.to_bytes(2, "big"), 0) == refused(0x2E, Nrc.SECURITY_ACCESS_DENIED), did
        assert not any(call[0] == "write" for call in bench.ecu.calls)


def test_routines_need_their_key_and_their_option_record(bench):
    for routine in Routine:
        request = b"\x31\x01" + routine.to_bytes(2, "big")
        if routine is not Routine.PRECONDITIONS:
            bench.ask(0x10, 2)
            assert bench.ask(request) == refused(0x31, Nrc.SECURITY_ACCESS_DENIED), routine
            bench.unlock(Level.CALIBRATION)
            assert bench.ask(request) == refused(0x31, Nrc.OUT_OF_RANGE), routine
            assert not any(call[0] == "routine" and call[1] is routine for call in bench.ecu.calls)
        bench.unlock()
        right = 36 if routine is Routine.ERASE else 0
        assert bench.ask(request, bytes(right + 1)) == refused(0x31, Nrc.INCORRECT_LENGTH), routine
        assert bench.ask(request, bytes(right)) == b"\x71" + request[1:]
        assert bench.ecu.calls[-1] == ("routine", routine, bytes(right))
    assert bench.ask(0x31, 1, 0x12, 0x34) == refused(0x31, Nrc.OUT_OF_RANGE)


def test_refusals_that_others_may_serve_are_not_sent_to_a_functional_request(bench):
    """ISO 14229-1:2020, section 7.5; what the tester was told to wait for is answered all the same."""

    def functional(text: str) -> None:
        talk(lambda request: bench.server.request(bench.now_ns, request, is_functional=True), text)

    # Codes 11, 12, 31, 7E and 7F.
    for request, code in (
        ("99 01", Nrc.SERVICE_NOT_SUPPORTED),
        ("10 04", Nrc.SUB_FUNCTION_NOT_SUPPORTED),
        ("22 FF FF", Nrc.OUT_OF_RANGE),
        ("31 01 FF 01", Nrc.SERVICE_NOT_IN_SESSION),
    ):
        bench.talk(f"{request} > {code.name}")
        functional(f"{request} > -")
    functional("22 F1 > INCORRECT_LENGTH\n3E 00 > 7E 00\n3E 80 > -\n22 F1 8C > 62 F1 8C 30 38 31 35")
    bench.talk("10 03 > ok\n27 01 > SUB_FUNCTION_NOT_IN_SESSION")
    functional("27 01 > -")
    bench.unlock()
    bench.ecu.pieces, bench.ecu.refusals = 2, {"routine": Nrc.OUT_OF_RANGE}
    for waits_ms, expected in ((1, []), (40, [refused(0x31, Nrc.RESPONSE_PENDING), refused(0x31, Nrc.OUT_OF_RANGE)])):
        functional("31 01 02 03 > -")
        assert bench.wait(waits_ms * MS) + bench.wait(MS) == expected


# Downloads, block by block; `tests/can_bridge/tester` loses and doubles requests.


def asking(length: int) -> str:
    return f"34 00 44 00x4 {length:08x}"


def test_download_requests(bench):
    bench.unlock()
    bench.talk(
        f"""
        34 10 44 00x8 > OUT_OF_RANGE
        34 01 44 00x8 > OUT_OF_RANGE
        34 00 33 00x8 > OUT_OF_RANGE
        34 00 24 00x8 > OUT_OF_RANGE
        34 00 44 00x7 > INCORRECT_LENGTH
        34 00 44 00x9 > INCORRECT_LENGTH
        34 00 44 00 00 00 07 00 00 00 0A > 74 20 {MAX_BLOCK:04x}
        {asking(5)} > CONDITIONS_NOT_CORRECT
        36 01 00x4 > 76 01
        34 00 44 00 00 00 07 00 00 00 0A > CONDITIONS_NOT_CORRECT
        10 02 > ok
        {asking(0)} > SECURITY_ACCESS_DENIED
        36 01 00 > SECURITY_ACCESS_DENIED
        37 > SECURITY_ACCESS_DENIED
        """
    )
    assert [call for call in bench.ecu.calls if call[0] == "download"] == [("download", 7, 10)]


def test_blocks_out_of_order_and_of_another_length(bench):
    bench.unlock()
    bench.talk(
        f"""
        36 01 AA > SEQUENCE_ERROR
        37 > SEQUENCE_ERROR
        {asking(4)} > ok
        {asking(4)} > ok
        36 00 AA > WRONG_BLOCK_COUNTER
        36 01 00x5 > TRANSFER_SUSPENDED
        36 01 AA BB > 76 01
        36 01 AA BB > 76 01
        36 00 CC > WRONG_BLOCK_COUNTER
        36 01 CC > WRONG_BLOCK_COUNTER
        36 03 CC > WRONG_BLOCK_COUNTER
        36 FF CC > WRONG_BLOCK_COUNTER
        37 > SEQUENCE_ERROR
        36 02 CC DD > 76 02
        36 02 CC DD > 76 02
        36 03 EE > SEQUENCE_ERROR
        37 > 77
        37 > 77
        36 02 CC DD > SEQUENCE_ERROR
        {asking(MAX_BLOCK)} > ok
        36 01 00x{MAX_BLOCK - 1} > INCORRECT_LENGTH
        36 01 00x{MAX_BLOCK - 2} > 76 01
        """
    )
    written = b"".join(call[1] for call in bench.ecu.calls if call[0] == "transfer")
    assert written[: -MAX_BLOCK + 2] == b"\xaa\xbb\xcc\xdd", "a block that is sent again is written once"


def test_what_ends_a_download(bench):
    bench.unlock()
    bench.talk(f"{asking(4)} > ok\n36 01 AA > ok\n31 01 FF 00 00x36 > ok\n36 02 BB > SEQUENCE_ERROR\n{asking(5)} > ok")
    bench.wait(5 * S)
    bench.unlock()
    bench.talk("36 01 AA > SEQUENCE_ERROR")
    bench.ecu.refusals = {"download": Nrc.OUT_OF_RANGE, "transfer": Nrc.PROGRAMMING_FAILURE}
    bench.talk(f"{asking(4)} > OUT_OF_RANGE\n36 01 AA > SEQUENCE_ERROR")
    del bench.ecu.refusals["download"]
    bench.talk(f"{asking(4)} > ok\n36 01 AA > PROGRAMMING_FAILURE")
    bench.ecu.refusals.clear()
    bench.talk("36 01 AA > SEQUENCE_ERROR")
