"""A tester's connection to an ECU in virtual time, without a bus, on which anything may be lost."""

from collections import deque
from collections.abc import Callable
from typing import Any, Self

from udsoncan.client import Client
from udsoncan.connections import BaseConnection
from udsoncan.exceptions import TimeoutException

from can_bridge.tester.asking import Asking
from can_bridge.tester.transport import answers, silence
from can_bridge.uds.security import AccessKey
from tests.can_bridge.flashing.store_ecu import KEY

NS = 1_000_000_000
TICK_NS = 20_000_000


class DirectConnection(BaseConnection):
    """udsoncan's connection to an ECU without a bus, always open; a subclass sends requests and waits for answers."""

    def __init__(self) -> None:
        super().__init__()
        silence()

    def open(self) -> Self:
        return self

    def close(self) -> None: ...

    def is_open(self) -> bool:
        return True


class Line(DirectConnection):
    """A tester's connection, by payloads, to an ECU with `server`, `is_reset` and `power_on`. `lose` is called with a
    payload, and with True for one to the ECU, and returns whether it is lost. `heard` has the requests that reached the
    ECU; `pending` counts response-pendings."""

    def __init__(self, ecu: Any) -> None:
        super().__init__()
        self.ecu = ecu
        self.now_ns = 0
        self.lose: Callable[[bytes, bool], bool] = lambda payload, to_ecu: False
        self.heard: list[bytes] = []
        self.pending = 0
        self._request = b""
        self._waiting: deque[bytes] = deque()

    def asking(self, key: AccessKey = KEY) -> Asking:
        return Asking(Client(self), key=key.answer, clock=self.clock, sleep=self.sleep)

    def clock(self) -> float:
        return self.now_ns / NS

    def sleep(self, seconds: float) -> None:
        until = self.now_ns + round(seconds * NS)
        while self.now_ns < until:
            self.now_ns = min(until, self.now_ns + TICK_NS)
            self._take(self.ecu.server.tick(self.now_ns))

    def arrive(self, payload: bytes) -> None:
        self._waiting.append(payload)

    def empty_rxqueue(self) -> None:
        self._waiting.clear()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        self._request = payload
        if not self.lose(payload, True):
            self.heard.append(payload)
            self._take(self.ecu.server.request(self.now_ns, payload))

    def specific_wait_frame(self, timeout: float | None = None) -> bytes:
        until = self.now_ns + round((timeout or 0.0) * NS)
        while self.now_ns <= until:
            while self._waiting:
                payload = self._waiting.popleft()
                if answers(self._request, payload):
                    return payload
            self.sleep(TICK_NS / NS)
        raise TimeoutException

    def _take(self, payloads: list[bytes]) -> None:
        if self.ecu.is_reset:
            self.ecu.power_on()
        for payload in payloads:
            self.pending += payload[:1] == b"\x7f" and payload[2:] == b"\x78"
            if not self.lose(payload, False):
                self._waiting.append(payload)
