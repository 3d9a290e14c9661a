"""The server as another implementation of ISO 14229 sees it: udsoncan's client, in virtual time.

The whole sequence of flashing goes through that client in `tests/can_bridge/tester`.
"""

from typing import Any

import pytest
from udsoncan.client import Client
from udsoncan.exceptions import NegativeResponseException
from udsoncan.Response import Response
from udsoncan.services.RoutineControl import RoutineControl

from can_bridge.flashing.access_level import Level
from can_bridge.uds.services import Nrc, Routine, Session
from tests.can_bridge.flashing.releases import provisioned
from tests.can_bridge.flashing.store_ecu import StoreEcu
from tests.can_bridge.tester.line import Line


@pytest.fixture
def client():
    memory = provisioned()
    config: Any = {"request_timeout": 10, "p2_timeout": 0.05, "p2_star_timeout": 5, "use_server_timing": True}
    with Client(Line(StoreEcu(lambda: memory)), config=config) as client:
        yield client


def test_refusals_have_their_names(client):
    def refused(expected: str, call: Any, *arguments: Any) -> None:
        with pytest.raises(NegativeResponseException) as refusal:
            call(*arguments)
        assert refusal.value.response.code_name == expected

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


def test_tester_present_keeps_the_session_of_the_announced_timing(client):
    answer = client.change_session(Session.EXTENDED)
    assert (answer.service_data.p2_server_max, answer.service_data.p2_star_server_max) == (0.05, 5.0)
    for _ in range(5):
        client.conn.time.sleep(4.0)
        with client.suppress_positive_response():
            client.tester_present()
    assert client.conn.ecu.server.session is Session.EXTENDED
