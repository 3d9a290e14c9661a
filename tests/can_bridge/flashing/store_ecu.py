"""An ECU that can be flashed, without its control: UDS server, programming and store over a memory that never fails."""

from random import Random
from typing import Final

from benchmarks.flash.fuzz_images import HARDWARE, ROOT, pool
from benchmarks.flash.plain_memory import PlainMemory
from can_bridge.flashing import report
from can_bridge.flashing.boot import Boot
from can_bridge.flashing.store import Store
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.access_key import AccessKey
from can_bridge.uds.diagnostics import Long
from can_bridge.uds.programming import Programming
from can_bridge.uds.refused import Refused
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Did, Nrc
from contract.controller.calibration import Calibration
from contract.errors import ConfigError
from contract.release import signing
from contract.release.bundle import Bundle

KEY: Final = AccessKey(bytes(range(16)))
CAPACITY: Final = 64 * 1024
_VALUES: Final = {Did.SERIAL_NUMBER: b"0815", Did.HARDWARE: HARDWARE.encode(), Did.SOFTWARE_VERSION: b"0"}


class FuzzedEcu:
    """Over one memory, from power-on to power-on.

    Args:
        rng: of seeds.

    Attributes:
        is_wanted: the vehicle asks for control, so that nothing may be programmed.
        server: of this power-on.
        programming: the same.
        store: the same.
    """

    def __init__(self, rng: Random) -> None:
        self._rng = rng
        self._is_reset = False
        self.is_wanted = False
        self.memory = PlainMemory(CAPACITY)
        known = pool()
        Store.provision(
            self.memory,
            root=signing.public_key(ROOT),
            keys=known.key_lists[0],
            image=known.images["first"],
            hardware=HARDWARE,
            fits=_fits,
        )
        self.power_on()

    def power_on(self) -> Boot:
        """All that is volatile anew."""
        self._is_reset = False
        self.store = Store(self.memory, root=signing.public_key(ROOT), hardware=HARDWARE, fits=_fits)
        boot = self.store.boot()
        self.programming = Programming(self.store, self, refusal=self._refusal, report=_report_of)
        self.server = UdsServer(self.programming, KEY, self._rng.randbytes)
        return boot

    @property
    def is_reset(self) -> bool:
        """A reset was asked for: `power_on` is due."""
        return self._is_reset

    def read(self, did: Did) -> bytes:
        if did not in _VALUES:
            raise Refused(Nrc.OUT_OF_RANGE)
        return _VALUES[did]

    def write(self, did: Did, value: bytes) -> Long[None]:
        yield
        if did is Did.CALIBRATION:
            try:
                Calibration.unpack(value)
            except ConfigError as error:
                raise Refused(Nrc.OUT_OF_RANGE, str(error)) from error

    def self_test(self) -> Long[bytes]:
        yield
        return b""

    def reset(self) -> None:
        self._is_reset = True

    def _refusal(self) -> Nrc | None:
        return Nrc.CONDITIONS_NOT_CORRECT if self.is_wanted else None


def _fits(bundle: Bundle) -> Verdict:
    return Verdict.GOOD


def _report_of(store: Store) -> bytes:
    return report.encode(report.report_of(store))
