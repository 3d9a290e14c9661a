"""The server as another implementation of ISO 14229 sees it: udsoncan's client, in virtual time."""

import hashlib
from typing import Any

import pytest
from udsoncan import DataFormatIdentifier, DidCodec, MemoryLocation
from udsoncan.client import Client
from udsoncan.exceptions import NegativeResponseException
from udsoncan.Response import Response
from udsoncan.services.ECUReset import ECUReset
from udsoncan.services.RoutineControl import RoutineControl

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.services import Did, Nrc, Routine, Session
from tests.can_bridge.flashing.releases import image, provisioned
from tests.can_bridge.flashing.store_ecu import KEY, StoreEcu
from tests.can_bridge.tester.line import Line


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
    memory = provisioned()
    with Client(Line(StoreEcu(lambda: memory)), config=config) as client:
        yield client


def test_flashing(client):
    new = image("newer")
    answer = client.change_session(Session.PROGRAMMING)
    assert (answer.service_data.p2_server_max, answer.service_data.p2_star_server_max) == (0.05, 5.0)
    for _ in range(2):  # the second time by a seed of zeros
        client.unlock_security_access(Level.PROGRAMMING)
    option = len(new).to_bytes(4, "big") + hashlib.sha256(new).digest()
    answer = client.start_routine(Routine.ERASE, option)
    assert answer.service_data.routine_status_record == bytes(4)
    location = MemoryLocation(address=0, memorysize=len(new), address_format=32, memorysize_format=32)
    answer = client.request_download(location, DataFormatIdentifier(0, 0))
    size = answer.service_data.max_length - 2
    for number, at in enumerate(range(0, len(new), size), start=1):
        client.transfer_data(number, new[at : at + size])
    client.request_transfer_exit()
    answer = client.start_routine(Routine.CHECK)
    assert answer.service_data.routine_status_record == bytes([Verdict.GOOD])
    assert client.conn.pending > 0
    client.start_routine(Routine.ACTIVATE)
    client.ecu_reset(ECUReset.ResetType.hardReset)
    client.conn.time.sleep(0.1)
    client.change_session(Session.PROGRAMMING)
    client.unlock_security_access(Level.PROGRAMMING)
    client.start_routine(Routine.SELF_TEST)
    client.start_routine(Routine.CONFIRM)
    store = client.conn.ecu.store
    assert store.state.slots[store.running].name == "newer"


def test_identifiers(client):
    answer = client.read_data_by_identifier([Did.ACTIVE_SESSION, Did.CAPACITY, Did.SERIAL_NUMBER])
    capacity = (200_000).to_bytes(4, "big")
    assert answer.service_data.values == {
        Did.ACTIVE_SESSION: b"\x01", Did.CAPACITY: capacity, Did.SERIAL_NUMBER: b"0815"
    }  # fmt: skip
    client.change_session(Session.EXTENDED)
    client.unlock_security_access(Level.CALIBRATION)
    client.write_data_by_identifier(Did.CALIBRATION, bytes(40))
    with pytest.raises(NegativeResponseException) as raised:
        client.write_data_by_identifier(Did.CALIBRATION, b"\xff" * 40)
    assert code(raised) == "RequestOutOfRange"


def code(raised: pytest.ExceptionInfo[NegativeResponseException]) -> str:
    return str(raised.value.response.code_name)


def test_refusals_have_their_names(client):
    def refused(expected: str, call: Any, *arguments: Any) -> None:
        with pytest.raises(NegativeResponseException) as raised:
            call(*arguments)
        assert code(raised) == expected

    refused("ServiceNotSupportedInActiveSession", client.request_seed, Level.PROGRAMMING)
    client.change_session(Session.PROGRAMMING)
    refused("SecurityAccessDenied", client.start_routine, Routine.ACTIVATE)
    results = RoutineControl.ControlType.requestRoutineResults
    refused("SubFunctionNotSupported", client.routine_control, Routine.ACTIVATE, results)
    for expected in ("InvalidKey", "InvalidKey", "ExceedNumberOfAttempts"):
        client.request_seed(Level.PROGRAMMING)
        refused(expected, client.send_key, Level.PROGRAMMING + 1, bytes(16))
    refused("RequiredTimeDelayNotExpired", client.request_seed, Level.PROGRAMMING)
    for nrc in Nrc:  # a code that the library does not know is named by its number
        assert str(Response.Code.get_name(nrc))[0].isalpha(), nrc


def test_tester_present_keeps_the_session(client):
    client.change_session(Session.EXTENDED)
    for _ in range(5):
        client.conn.time.sleep(4.0)
        with client.suppress_positive_response():
            client.tester_present()
    assert client.conn.ecu.server.session is Session.EXTENDED
