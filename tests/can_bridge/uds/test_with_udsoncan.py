"""The server as another implementation of ISO 14229 sees it: udsoncan's client, in virtual time."""

import hashlib
from collections import deque
from random import Random
from typing import Any

import pytest
from udsoncan import DataFormatIdentifier, DidCodec, MemoryLocation
from udsoncan.client import Client
from udsoncan.exceptions import NegativeResponseException, TimeoutException
from udsoncan.Response import Response
from udsoncan.services.ECUReset import ECUReset
from udsoncan.services.RoutineControl import RoutineControl

from benchmarks.flash.fuzz_ecu import KEY, FuzzedEcu
from benchmarks.flash.fuzz_images import pool
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.verdicts import Verdict
from can_bridge.tester.direct_connection import DirectConnection
from can_bridge.uds.services import Did, Nrc, Routine, Session
from tests.can_bridge.uds.scripted_ecu import MS

PIECE_NS = 40 * MS
"""Of work: long enough for response-pending."""


class Direct(DirectConnection):
    """Requests go into the server at once; waiting lets its time pass."""

    def __init__(self, ecu: FuzzedEcu) -> None:
        super().__init__()
        self.ecu = ecu
        self.now_ns = 0
        self.waiting: deque[bytes] = deque()
        self.pending = 0

    def empty_rxqueue(self) -> None:
        self.waiting.clear()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        self._take(self.ecu.server.request(self.now_ns, bytes(payload)))

    def specific_wait_frame(self, timeout: float | None = 2.0) -> bytes | None:
        end_ns = self.now_ns + round((timeout or 0.0) * 1e9)
        while not self.waiting:
            if self.now_ns >= end_ns:
                raise TimeoutException
            self.now_ns += PIECE_NS
            self._take(self.ecu.server.tick(self.now_ns))
        return self.waiting.popleft()

    def _take(self, answers: list[bytes]) -> None:
        self.pending += sum(answer[2:] == b"\x78" for answer in answers if answer[0] == 0x7F)
        self.waiting += answers


class Bytes(DidCodec):
    """An identifier's value as it is."""

    def __init__(self, length: int | None = None) -> None:
        self.length = length

    def encode(self, *values: bytes) -> bytes:
        return values[0]

    def decode(self, payload: bytes) -> bytes:
        return payload

    def __len__(self) -> int:
        if self.length is None:
            raise DidCodec.ReadAllRemainingData
        return self.length


@pytest.fixture
def client():
    dids = {did: Bytes() for did in Did} | {Did.CAPACITY: Bytes(4), Did.ACTIVE_SESSION: Bytes(1)}
    config: Any = {
        "exception_on_invalid_response": True,
        "exception_on_unexpected_response": True,
        "security_algo": lambda level, seed, params: KEY.answer(Level(level), bytes(seed)),
        "data_identifiers": dids,
        "server_address_format": 32,
        "server_memorysize_format": 32,
        "request_timeout": 10,
        "p2_timeout": 0.05,
        "p2_star_timeout": 5,
        "use_server_timing": True,
    }
    with Client(Direct(FuzzedEcu(Random(0))), config=config) as client:
        yield client


def code(raised: pytest.ExceptionInfo[NegativeResponseException]) -> str:
    return str(raised.value.response.code_name)


def test_flashing(client):
    connection, image = client.conn, pool().images["newer"]
    answer = client.change_session(Session.PROGRAMMING)
    assert (answer.service_data.p2_server_max, answer.service_data.p2_star_server_max) == (0.05, 5.0)
    client.unlock_security_access(Level.PROGRAMMING)
    option = len(image).to_bytes(4, "big") + hashlib.sha256(image).digest()
    answer = client.start_routine(Routine.ERASE, option)
    assert answer.service_data.routine_status_record == bytes(4)
    location = MemoryLocation(address=0, memorysize=len(image), address_format=32, memorysize_format=32)
    answer = client.request_download(location, DataFormatIdentifier(0, 0))
    size = answer.service_data.max_length - 2
    for number, at in enumerate(range(0, len(image), size), start=1):
        client.transfer_data(number, image[at : at + size])
    client.request_transfer_exit()
    answer = client.start_routine(Routine.CHECK)
    assert answer.service_data.routine_status_record == bytes([Verdict.GOOD])
    assert connection.pending > 0
    client.start_routine(Routine.ACTIVATE)
    client.ecu_reset(ECUReset.ResetType.hardReset)
    connection.ecu.server.tick(connection.now_ns)
    assert connection.ecu.is_reset
    connection.ecu.power_on()
    client.change_session(Session.PROGRAMMING)
    client.unlock_security_access(Level.PROGRAMMING)
    client.start_routine(Routine.SELF_TEST)
    client.start_routine(Routine.CONFIRM)
    assert connection.ecu.store.state.slots[connection.ecu.store.running].name == "newer"


def test_unlocked_level_is_told_by_a_seed_of_zeros(client):
    client.change_session(Session.PROGRAMMING)
    client.unlock_security_access(Level.PROGRAMMING)
    client.unlock_security_access(Level.PROGRAMMING)
    assert client.conn.ecu.server.unlocked is Level.PROGRAMMING


def test_identifiers(client):
    answer = client.read_data_by_identifier([Did.ACTIVE_SESSION, Did.CAPACITY, Did.SERIAL_NUMBER])
    assert answer.service_data.values == {
        Did.ACTIVE_SESSION: b"\x01",
        Did.CAPACITY: (64 * 1024).to_bytes(4, "big"),
        Did.SERIAL_NUMBER: b"0815",
    }


def test_writing(client):
    client.change_session(Session.EXTENDED)
    client.unlock_security_access(Level.CALIBRATION)
    client.write_data_by_identifier(Did.CALIBRATION, bytes(40))
    with pytest.raises(NegativeResponseException) as raised:
        client.write_data_by_identifier(Did.CALIBRATION, b"\xff" * 40)
    assert code(raised) == "RequestOutOfRange"


def test_refusals_have_their_names(client):
    with pytest.raises(NegativeResponseException) as raised:
        client.request_seed(Level.PROGRAMMING)
    assert code(raised) == "ServiceNotSupportedInActiveSession"
    client.change_session(Session.PROGRAMMING)
    with pytest.raises(NegativeResponseException) as raised:
        client.start_routine(Routine.ACTIVATE)
    assert code(raised) == "SecurityAccessDenied"
    with pytest.raises(NegativeResponseException) as raised:
        client.routine_control(Routine.ACTIVATE, RoutineControl.ControlType.requestRoutineResults)
    assert code(raised) == "SubFunctionNotSupported"
    for expected in ("InvalidKey", "InvalidKey", "ExceedNumberOfAttempts"):
        client.request_seed(Level.PROGRAMMING)
        with pytest.raises(NegativeResponseException) as raised:
            client.send_key(Level.PROGRAMMING + 1, bytes(16))
        assert code(raised) == expected
    with pytest.raises(NegativeResponseException) as raised:
        client.request_seed(Level.PROGRAMMING)
    assert code(raised) == "RequiredTimeDelayNotExpired"


def test_tester_present_keeps_the_session(client):
    client.change_session(Session.EXTENDED)
    for _ in range(5):
        client.conn.now_ns += 4000 * MS
        with client.suppress_positive_response():
            client.tester_present()
    assert client.conn.ecu.server.session is Session.EXTENDED


@pytest.mark.parametrize("nrc", Nrc)
def test_every_code_is_one_that_the_library_knows(nrc):
    # One that it does not know is named by its number.
    assert str(Response.Code.get_name(nrc))[0].isalpha()
