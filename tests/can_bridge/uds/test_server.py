"""Sessions, timing, and each negative response outside security access and transfers."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.flashing.access_level import Level
from can_bridge.uds.refused import Refused
from can_bridge.uds.services import Did, Nrc, Routine, Service, Session
from tests.can_bridge.uds.scripted_ecu import MS, Bench, S, refused
from tests.examples import examples

PRECONDITIONS = Routine.PRECONDITIONS.to_bytes(2, "big")
CHECK = Routine.CHECK.to_bytes(2, "big")
SERIAL = Did.SERIAL_NUMBER.to_bytes(2, "big")
CALIBRATION = Did.CALIBRATION.to_bytes(2, "big")
STORED = Did.CALIBRATION_STORED.to_bytes(2, "big")
KEY_LIST = Did.KEY_LIST.to_bytes(2, "big")


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_session_answers_with_its_timing(bench):
    """P2 50 ms and P2* 500 times 10 ms."""
    assert bench.ask(0x10, 3) == bytes.fromhex("5003 0032 01f4")
    assert bench.server.session == Session.EXTENDED
    assert bench.ask(0x22, Did.ACTIVE_SESSION.to_bytes(2, "big")) == bytes.fromhex("62f186 03")


def test_no_bytes_are_no_request(bench):
    assert bench.server.request(0, b"") == []


@pytest.mark.parametrize("service", sorted(set(range(256)) - set(Service)))
def test_other_services_are_not_there(bench, service):
    assert bench.ask(service, 1, 2, 3) == refused(service, Nrc.SERVICE_NOT_SUPPORTED)


@pytest.mark.parametrize(
    ("session", "absent"),
    [
        (Session.DEFAULT, {0x11, 0x27, 0x2E, 0x31, 0x34, 0x36, 0x37}),
        (Session.EXTENDED, {0x11, 0x34, 0x36, 0x37}),
        (Session.PROGRAMMING, set()),
    ],
)
def test_services_of_each_session(bench, session, absent):
    bench.ask(0x10, session)
    not_there = {service for service in Service if bench.ask(service) == refused(service, Nrc.SERVICE_NOT_IN_SESSION)}
    assert not_there == absent


@pytest.mark.parametrize(
    "request_hex",
    [
        *("10", "1001 00", "11", "1101 00", "3e", "3e00 00"),
        *("22", "22f1", "22f18c f1", "22" + 17 * "f18c", "2e", "2ef18c"),
        *("27", "31", "3101", "310102", "31010203 00"),
        *("34", "3400", "34004400", "36", "3601", "37 00"),
    ],
)
def test_wrong_lengths(bench, request_hex):
    bench.unlock()
    raw = bytes.fromhex(request_hex)
    assert bench.ask(raw) == refused(raw[0], Nrc.INCORRECT_LENGTH)


def test_a_request_longer_than_iso_tp_carries(bench):
    bench.unlock()
    assert bench.ask(0x2E, KEY_LIST, bytes(4092)) == b"\x6e" + KEY_LIST
    assert bench.ask(0x2E, KEY_LIST, bytes(4093)) == refused(0x2E, Nrc.INCORRECT_LENGTH)


@pytest.mark.parametrize("request_hex", ["1000", "1004", "1060", "1100", "1102", "3102ff00", "3103ff00", "3e01"])
def test_other_sub_functions(bench, request_hex):
    bench.unlock()
    raw = bytes.fromhex(request_hex)
    assert bench.ask(raw) == refused(raw[0], Nrc.SUB_FUNCTION_NOT_SUPPORTED)


def test_length_comes_before_sub_function_only_where_there_is_none(bench):
    """ISO 14229-1: at least two bytes, then the sub-function, then the whole length."""
    assert bench.ask(0x3E, 1, 0) == refused(0x3E, Nrc.SUB_FUNCTION_NOT_SUPPORTED)


def test_refused_session_leaves_the_one_before(bench):
    bench.unlock()
    bench.ecu.refusals["enter"] = Nrc.CONDITIONS_NOT_CORRECT
    assert bench.ask(0x10, 2) == refused(0x10, Nrc.CONDITIONS_NOT_CORRECT)
    assert (bench.server.session, bench.server.unlocked) == (Session.PROGRAMMING, Level.PROGRAMMING)


@pytest.mark.parametrize("session", Session)
def test_every_change_of_session_locks_and_leaves(bench, session):
    bench.unlock()
    bench.ecu.calls.clear()
    bench.ask(0x10, session)
    assert bench.server.unlocked is None
    assert bench.ecu.calls == [("enter", session), ("leave",)]


def test_default_session_is_not_left(bench):
    bench.ask(0x10, 1)
    bench.wait(60 * S)
    assert bench.ecu.calls == [("enter", Session.DEFAULT)]


def test_silence_ends_a_session(bench):
    bench.unlock()
    bench.wait(5 * S - 1)
    assert bench.server.session == Session.PROGRAMMING
    bench.wait(1)
    assert bench.server.session == Session.DEFAULT
    assert bench.server.unlocked is None
    assert bench.ecu.calls[-1] == ("leave",)


def test_silence_ends_a_session_without_a_tick(bench):
    bench.ask(0x10, 3)
    bench.now_ns = 5 * S
    assert bench.ask(0x31, 1, PRECONDITIONS) == refused(0x31, Nrc.SERVICE_NOT_IN_SESSION)


@pytest.mark.parametrize("heard", [b"\x3e\x80", b"\x3e\x00", b"\x22\xf1\x8c", b"\x99"])
def test_any_request_keeps_a_session(bench, heard):
    bench.ask(0x10, 3)
    for _ in range(3):
        bench.wait(4 * S)
        bench.ask(heard)
    assert bench.server.session == Session.EXTENDED


def test_work_keeps_a_session(bench):
    """S3 stands while a request is worked on, and begins with its answer."""
    bench.unlock()
    bench.ecu.pieces = 3
    assert bench.ask(0x31, 1, CHECK) is None
    for _ in range(3):
        bench.wait(4 * S)
    assert bench.server.session == Session.PROGRAMMING
    bench.wait(5 * S - 1)
    assert bench.server.session == Session.PROGRAMMING
    bench.wait(1)
    assert bench.server.session == Session.DEFAULT


def test_a_clock_that_goes_back_ends_nothing(bench):
    bench.now_ns = 100 * S
    bench.ask(0x10, 3)
    bench.wait(-90 * S)
    assert bench.server.session == Session.EXTENDED


def test_positive_answers_are_suppressed_and_negative_ones_are_not(bench):
    assert bench.ask(0x10, 0x83) is None
    assert bench.server.session == Session.EXTENDED
    assert bench.ask(0x3E, 0x80) is None
    assert bench.ask(0x31, 0x81, PRECONDITIONS) is None
    assert ("routine", Routine.PRECONDITIONS, b"") in bench.ecu.calls
    assert bench.ask(0x10, 0x84) == refused(0x10, Nrc.SUB_FUNCTION_NOT_SUPPORTED)


def test_a_block_counter_is_no_sub_function(bench):
    bench.unlock()
    assert bench.ask(0x36, 0x81, 0) == refused(0x36, Nrc.SEQUENCE_ERROR)


def test_reset_is_answered_before_it_happens(bench):
    bench.ask(0x10, 2)
    assert bench.ask(0x11, 1) == b"\x51\x01"
    assert ("reset",) not in bench.ecu.calls
    assert bench.server.is_busy
    assert bench.ask(0x10, 1) == refused(0x10, Nrc.BUSY_REPEAT_REQUEST)
    assert bench.wait(MS) == []
    assert bench.ecu.calls.count(("reset",)) == 1
    bench.wait(MS)
    assert bench.ecu.calls.count(("reset",)) == 1


class TestPending:
    def test_long_work_is_announced_in_time(self, bench):
        bench.unlock()
        bench.ecu.pieces, bench.ecu.status = 1000, b"\x05"
        start_ns = bench.now_ns
        assert bench.ask(0x31, 1, CHECK) is None
        sent = []
        while bench.server.is_busy:
            sent += [(bench.now_ns - start_ns, answer) for answer in bench.wait(10 * MS)]
        pending = [time for time, answer in sent if answer == refused(0x31, Nrc.RESPONSE_PENDING)]
        assert sent[-1] == (10 * S, b"\x71\x01" + CHECK + b"\x05")
        assert len(sent) == len(pending) + 1
        # P2 is 50 ms, P2* 5 s.
        assert 0 < pending[0] <= 50 * MS
        assert all(0 < later - earlier <= 5 * S for earlier, later in itertools.pairwise(pending))
        assert sent[-1][0] - pending[-1] <= 5 * S

    def test_short_work_is_answered_at_once(self, bench):
        bench.ask(0x10, 3)
        bench.ecu.status = b"\x01\x02"
        assert bench.ask(0x31, 1, PRECONDITIONS) == b"\x71\x01" + PRECONDITIONS + b"\x01\x02"

    def test_who_was_told_to_wait_gets_an_answer(self, bench):
        bench.unlock()
        bench.ecu.pieces = 2
        assert bench.ask(0x31, 0x81, CHECK) is None
        assert bench.wait(40 * MS) == [refused(0x31, Nrc.RESPONSE_PENDING)]
        assert bench.wait(40 * MS) == [b"\x71\x01" + CHECK]

    def test_suppressed_work_that_is_done_in_time_says_nothing(self, bench):
        bench.unlock()
        bench.ecu.pieces = 2
        assert bench.ask(0x31, 0x81, CHECK) is None
        assert bench.wait(10 * MS) + bench.wait(10 * MS) == []
        assert not bench.server.is_busy

    def test_refusal_at_the_end_of_long_work(self, bench):
        bench.unlock()
        bench.ecu.pieces, bench.ecu.refusals["routine"] = 1, Nrc.PROGRAMMING_FAILURE
        assert bench.ask(0x31, 1, CHECK) is None
        assert bench.wait(MS) == [refused(0x31, Nrc.PROGRAMMING_FAILURE)]

    def test_other_requests_wait(self, bench):
        bench.unlock()
        bench.ecu.pieces = 2
        bench.ask(0x31, 1, CHECK)
        assert bench.ask(0x10, 1) == refused(0x10, Nrc.BUSY_REPEAT_REQUEST)
        assert bench.ask(0x3E, 0x80) is None
        assert bench.ask(0x3E, 0x00) == refused(0x3E, Nrc.BUSY_REPEAT_REQUEST)
        assert bench.wait(MS) + bench.wait(MS) == [b"\x71\x01" + CHECK]
        assert bench.server.session == Session.PROGRAMMING

    def test_an_error_of_the_ecu_is_not_hidden_and_ends_the_work(self, bench, monkeypatch):
        monkeypatch.setattr(bench.ecu, "read", lambda did: 1 // 0)
        with pytest.raises(ZeroDivisionError):
            bench.ask(0x22, SERIAL)
        assert not bench.server.is_busy


class TestReading:
    def test_value(self, bench):
        assert bench.ask(0x22, SERIAL) == b"\x62\xf1\x8c0815"

    @pytest.mark.parametrize("number", [0x0000, 0xFD11, 0xFFFF])
    def test_what_is_not_there(self, bench, number):
        assert bench.ask(0x22, number.to_bytes(2, "big")) == refused(0x22, Nrc.OUT_OF_RANGE)

    def test_several_at_once_without_those_that_are_not_there(self, bench):
        hardware = Did.HARDWARE.to_bytes(2, "big")
        assert bench.ask(0x22, SERIAL, b"\0\0", hardware) == b"\x62\xf1\x8c0815\xf1\x91bench"

    def test_refusal_for_another_reason_is_told(self, bench):
        bench.ecu.refusals["read"] = Nrc.CONDITIONS_NOT_CORRECT
        assert bench.ask(0x22, SERIAL) == refused(0x22, Nrc.CONDITIONS_NOT_CORRECT)

    def test_answer_that_does_not_fit(self, bench):
        store = Did.STORE.to_bytes(2, "big")
        bench.ecu.values[Did.STORE] = bytes(4092)
        assert bench.ask(0x22, store) == b"\x62" + store + bytes(4092)
        bench.ecu.values[Did.STORE] = bytes(4093)
        assert bench.ask(0x22, store) == refused(0x22, Nrc.RESPONSE_TOO_LONG)


class TestWriting:
    def test_value_is_written(self, bench):
        bench.unlock(Level.CALIBRATION)
        assert bench.ask(0x2E, STORED, 1) == b"\x6e" + STORED
        assert bench.ecu.calls[-1] == ("write", Did.CALIBRATION_STORED, b"\x01")

    @pytest.mark.parametrize("did", sorted(set(Did) - {Did.KEY_LIST, Did.CALIBRATION, Did.CALIBRATION_STORED}))
    def test_what_can_only_be_read(self, bench, did):
        for level in Level:
            bench.unlock(level)
            assert bench.ask(0x2E, did.to_bytes(2, "big"), bytes(8)) == refused(0x2E, Nrc.OUT_OF_RANGE)

    def test_what_is_not_there(self, bench):
        bench.unlock()
        assert bench.ask(0x2E, 0, 0, 0) == refused(0x2E, Nrc.OUT_OF_RANGE)

    def test_identifiers_are_of_their_sessions(self, bench):
        bench.unlock(Level.PROGRAMMING)
        assert bench.ask(0x2E, CALIBRATION, bytes(40)) == refused(0x2E, Nrc.OUT_OF_RANGE)
        bench.unlock(Level.CALIBRATION)
        assert bench.ask(0x2E, KEY_LIST, bytes(99)) == refused(0x2E, Nrc.OUT_OF_RANGE)

    @pytest.mark.parametrize(("session", "did"), [(2, KEY_LIST), (3, CALIBRATION), (3, STORED)])
    def test_locked(self, bench, session, did):
        bench.ask(0x10, session)
        assert bench.ask(0x2E, did, 0) == refused(0x2E, Nrc.SECURITY_ACCESS_DENIED)
        assert not any(call[0] == "write" for call in bench.ecu.calls)

    def test_length_of_the_value(self, bench):
        bench.unlock(Level.CALIBRATION)
        for value in (bytes(39), bytes(41)):
            assert bench.ask(0x2E, CALIBRATION, value) == refused(0x2E, Nrc.INCORRECT_LENGTH)
        assert bench.ask(0x2E, CALIBRATION, bytes(40)) == b"\x6e" + CALIBRATION

    def test_the_ecu_may_refuse(self, bench):
        bench.unlock(Level.CALIBRATION)
        bench.ecu.refusals["write"] = Nrc.OUT_OF_RANGE
        assert bench.ask(0x2E, CALIBRATION, bytes(40)) == refused(0x2E, Nrc.OUT_OF_RANGE)


class TestRoutines:
    @pytest.mark.parametrize("routine", sorted(set(Routine) - {Routine.PRECONDITIONS}))
    def test_locked(self, bench, routine):
        bench.ask(0x10, 2)
        number = routine.to_bytes(2, "big")
        assert bench.ask(0x31, 1, number) == refused(0x31, Nrc.SECURITY_ACCESS_DENIED)
        assert not any(call[0] == "routine" for call in bench.ecu.calls)

    @pytest.mark.parametrize("routine", sorted(set(Routine) - {Routine.PRECONDITIONS}))
    def test_another_level_opens_nothing(self, bench, routine):
        bench.unlock(Level.CALIBRATION)
        assert bench.ask(0x31, 1, routine.to_bytes(2, "big")) == refused(0x31, Nrc.OUT_OF_RANGE)

    def test_what_is_not_there(self, bench):
        bench.unlock()
        assert bench.ask(0x31, 1, 0x12, 0x34) == refused(0x31, Nrc.OUT_OF_RANGE)

    @pytest.mark.parametrize("routine", Routine)
    def test_option_record(self, bench, routine):
        bench.unlock()
        number = routine.to_bytes(2, "big")
        right = 36 if routine is Routine.ERASE else 0
        assert bench.ask(0x31, 1, number, bytes(right + 1)) == refused(0x31, Nrc.INCORRECT_LENGTH)
        assert bench.ask(0x31, 1, number, bytes(right)) == b"\x71\x01" + number
        assert bench.ecu.calls[-1] == ("routine", routine, bytes(right))


@given(
    st.lists(st.one_of(st.binary(max_size=40), st.sampled_from([b"\x10\x02", b"\x10\x03", b"\x27\x01", b"\x11\x01"])))
)
@examples(200)
def test_any_bytes_are_answered_by_the_form_of_the_standard(requests):
    bench = Bench()
    for raw in requests:
        answers = bench.server.request(bench.now_ns, raw) + bench.wait(MS)
        assert len(answers) <= 1
        for answer in answers:
            if answer[0] == 0x7F:
                assert answer[1] == raw[0]
                assert answer[2] in frozenset(Nrc)
                assert len(answer) == 3
            else:
                assert answer[0] == raw[0] + 0x40
        assert bench.server.unlocked is None


def test_refusal_names_its_code():
    assert str(Refused(Nrc.OUT_OF_RANGE)) == "OUT_OF_RANGE"
    assert str(Refused(Nrc.OUT_OF_RANGE, "value 7")) == "value 7"
