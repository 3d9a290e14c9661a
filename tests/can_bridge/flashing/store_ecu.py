"""An ECU that can be flashed, without its control: store, programming services and UDS server over a memory."""

from collections.abc import Callable

from can_bridge.flashing import report
from can_bridge.flashing.backing import Backing
from can_bridge.flashing.boot import Boot
from can_bridge.uds.access_key import AccessKey
from can_bridge.uds.diagnostics import Long
from can_bridge.uds.programming import Programming
from can_bridge.uds.refused import Refused
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Did, Nrc
from contract.controller.calibration import Calibration
from contract.errors import ConfigError
from contract.release.bundle import dbc_sha256
from tests.can_bridge.flashing.releases import HARDWARE, booted

SECRET = bytes(range(1, 17))
KEY = AccessKey(SECRET)
VALUES = {
    Did.HARDWARE: HARDWARE.encode(),
    Did.SERIAL_NUMBER: b"0815",
    Did.SOFTWARE_VERSION: b"bench",
    Did.DBC_SHA256: bytes.fromhex(dbc_sha256()),
    Did.PERIOD_NS: (20_000_000).to_bytes(8, "big"),
}


class Counted:
    """Bytes for seeds that nobody needs to guess: a counter."""

    def __init__(self) -> None:
        self._count = 0

    def __call__(self, length: int) -> bytes:
        self._count += 1
        return self._count.to_bytes(length, "big")


class StoreEcu:
    """From power-on to power-on.

    Args:
        backing: opens the memory.
        random_bytes: for seeds.

    Attributes:
        is_wanted: the vehicle asks for control, so that nothing may be programmed.
        is_reset: a reset was asked for: `power_on` is due.
        store, boot, programming, server: of this power-on.
    """

    is_dead = False

    def __init__(self, backing: Callable[[], Backing], random_bytes: Callable[[int], bytes] | None = None) -> None:
        self._backing, self._random_bytes = backing, random_bytes or Counted()
        self.is_wanted = False
        self.power_on()

    def power_on(self) -> Boot:
        self.is_reset = False
        self.store, self.boot = booted(self._backing())
        self.programming = Programming(
            self.store,
            self,
            refusal=lambda: Nrc.CONDITIONS_NOT_CORRECT if self.is_wanted else None,
            report=lambda store: report.encode(report.report_of(store)),
        )
        self.server = UdsServer(self.programming, KEY, self._random_bytes)
        return self.boot

    # What the store has no part in.

    def read(self, did: Did) -> bytes:
        if did not in VALUES:
            raise Refused(Nrc.OUT_OF_RANGE)
        return VALUES[did]

    def write(self, did: Did, value: bytes) -> Long[None]:
        yield
        if did is Did.CALIBRATION:
            try:
                Calibration.unpack(value)
            except ConfigError as error:
                raise Refused(Nrc.OUT_OF_RANGE, str(error)) from error

    def self_test(self) -> Long[bytes]:
        yield
        if self.boot.bundle is None:
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT)
        return b""

    def reset(self) -> None:
        self.is_reset = True
