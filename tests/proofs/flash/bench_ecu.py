"""An ECU for the proof: store, programming services and UDS server as in a vehicle, and a tester's line to it.

There is no ISO-TP and no bus between them: what they lose is another test's. Time is virtual and passes where the
tester waits. Everything but the memory is made anew at each reset, as by a loss of supply.
"""

from collections import deque
from collections.abc import Callable

from udsoncan.exceptions import TimeoutException

from benchmarks.flash.releases import ACCESS, HARDWARE, ROOT, fits
from can_bridge.flashing.backing import Backing
from can_bridge.flashing.boot import Boot
from can_bridge.flashing.report import encode, report_of
from can_bridge.flashing.store import Store
from can_bridge.tester.direct_connection import DirectConnection
from can_bridge.uds.access_key import AccessKey
from can_bridge.uds.diagnostics import Long
from can_bridge.uds.programming import Programming
from can_bridge.uds.refused import Refused
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Did, Nrc
from contract.release.bundle import dbc_sha256

_NS = 1_000_000_000
_TICK_NS = 10_000_000


class BenchEcu(DirectConnection):
    """The ECU, and the tester's connection to it, by payloads.

    Attributes:
        store: from the last boot on.
        boot: what it came to.
    """

    def __init__(self, backing: Callable[[], Backing]) -> None:
        """Power on.

        Args:
            backing: opens the memory, at power-on and at each reset.
        """
        super().__init__()
        self._backing = backing
        self._now_ns = 0
        self._seeds = 0
        self._answers: deque[bytes] = deque()
        self.store, self.boot = self._power_on()

    def clock(self) -> float:
        """Virtual seconds."""
        return self._now_ns / _NS

    def sleep(self, seconds: float) -> None:
        """Let them pass."""
        until = self._now_ns + round(seconds * _NS)
        while self._now_ns < until:
            self._now_ns = min(until, self._now_ns + _TICK_NS)
            self._answers.extend(self._server.tick(self._now_ns))

    def empty_rxqueue(self) -> None:
        self._answers.clear()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        self._answers.extend(self._server.request(self._now_ns, payload))

    def specific_wait_frame(self, timeout: float | None = None) -> bytes:
        until = self._now_ns + round((timeout or 0.0) * _NS)
        while not self._answers:
            if self._now_ns >= until:
                raise TimeoutException
            self.sleep(_TICK_NS / _NS)
        return self._answers.popleft()

    def _power_on(self) -> tuple[Store, Boot]:
        self.store = Store(self._backing(), root=ROOT, hardware=HARDWARE, fits=fits)
        self.boot = self.store.boot()
        programming = Programming(
            self.store, _Inner(self), refusal=lambda: None, report=lambda store: encode(report_of(store))
        )
        self._server = UdsServer(programming, AccessKey(ACCESS), self._random)
        return self.store, self.boot

    def _random(self, count: int) -> bytes:
        self._seeds += 1
        return self._seeds.to_bytes(count, "big")


def _report(store: Store) -> bytes:
    return encode(report_of(store))


class _Inner:
    """The rest of the ECU."""

    def __init__(self, ecu: BenchEcu) -> None:
        self._ecu = ecu

    def read(self, did: Did) -> bytes:
        values = {
            Did.HARDWARE: HARDWARE.encode(),
            Did.SERIAL_NUMBER: b"1",
            Did.SOFTWARE_VERSION: b"bench",
            Did.DBC_SHA256: bytes.fromhex(dbc_sha256()),
            Did.PERIOD_NS: (20_000_000).to_bytes(8, "big"),
        }
        if did not in values:
            raise Refused(Nrc.OUT_OF_RANGE)
        return values[did]

    def write(self, did: Did, value: bytes) -> Long[None]:
        yield from ()
        raise Refused(Nrc.OUT_OF_RANGE)

    def self_test(self) -> Long[bytes]:
        yield from ()
        if self._ecu.boot.bundle is None:
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT)
        return b""

    def reset(self) -> None:
        self._ecu._power_on()
