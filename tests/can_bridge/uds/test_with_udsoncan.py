"""The server as another implementation of ISO 14229 sees it: udsoncan's client, in virtual time.

The whole sequence of flashing goes through that client in `tests/can_bridge/tester`.
"""

from typing import Any

from udsoncan.client import Client

from can_bridge.uds.services import Session
from tests.can_bridge.flashing.releases import provisioned
from tests.can_bridge.flashing.store_ecu import StoreEcu
from tests.can_bridge.tester.line import Line


def test_tester_present_keeps_the_session_of_the_announced_timing():
    memory = provisioned()
    config: Any = {"request_timeout": 10, "p2_timeout": 0.05, "p2_star_timeout": 5, "use_server_timing": True}
    line = Line(StoreEcu(lambda: memory))
    with Client(line, config=config) as client:
        answer = client.change_session(Session.EXTENDED)
        assert (answer.service_data.p2_server_max, answer.service_data.p2_star_server_max) == (0.05, 5.0)
        for _ in range(5):
            line.time.sleep(4.0)
            with client.suppress_positive_response:
                client.tester_present()
        assert line.ecu.server.session is Session.EXTENDED
