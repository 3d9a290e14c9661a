"""An ECU that can be flashed, without its control: store, programming services and UDS server over a memory."""

from collections.abc import Callable, Iterator
from hashlib import sha256
from itertools import count

from can_bridge.flashing.backing import Backing, Long
from can_bridge.flashing.state import Level
from can_bridge.flashing.store import Boot
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.calibration_service import CalibrationService
from can_bridge.uds.ecu_services import EcuServices
from can_bridge.uds.fault_memory import FaultMemory
from can_bridge.uds.security import AccessKey
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Did, Nrc, Refused, Routine
from contract.release.checks import dbc_sha256
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


def counted() -> Callable[[int], bytes]:
    """Bytes for seeds that nobody needs to guess: a counter."""
    numbers = count(1)
    return lambda length: next(numbers).to_bytes(length, "big")


class StoreEcu:
    """The ECU from one power-on to the next; `backing` opens its memory. While `is_wanted`, the vehicle asks for
    control, and nothing may be programmed; after a reset (`is_reset`) `power_on` is due. `values` are those of
    identifiers that the store has no part in."""

    def __init__(self, backing: Callable[[], Backing]) -> None:
        self._backing, self._random_bytes = backing, counted()
        self.is_wanted = False
        self.resets, self.routines, self.values = 0, list[Routine](), dict(VALUES)
        self.power_on()

    def power_on(self) -> Boot:
        self.is_reset = False
        self.store, self.boot = booted(self._backing())
        self.services = _Noted(
            self.store,
            self.values,
            calibration=self.calibration(self.boot),
            self_test=lambda: self.self_test(),
            refusal=lambda: Nrc.CONDITIONS_NOT_CORRECT if self.is_wanted else None,
            on_reset=self.reset,
            log=lambda *_, **fields: None,
        )
        self.services.routines = self.routines
        self.server = UdsServer(self.services, KEY, self._random_bytes, FaultMemory())
        return self.boot

    def calibration(self, boot: Boot) -> CalibrationService | None:
        return None

    def self_test(self) -> Long[None]:
        yield
        if self.boot.bundle is None:
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT)

    def reset(self) -> None:
        self.is_reset = True
        self.resets += 1


class _Noted(EcuServices):
    routines: list[Routine]

    def leave(self) -> None:
        """End the transfer alone: the tests of a power-on do without the reset."""
        self._store.drop()

    def routine(self, routine: Routine, option: bytes) -> Long[bytes]:
        status = yield from super().routine(routine, option)
        self.routines.append(routine)
        return status


class FlashingSteps:
    def ask(self, request: bytes, /) -> bytes:
        raise NotImplementedError

    def good(self, request: bytes) -> bytes:
        answer = self.ask(request)
        assert answer[0] == request[0] + 0x40, (request[:8].hex(), answer.hex())
        return answer

    def programming(self) -> None:
        self.good(b"\x10\x02")
        self.unlock(Level.PROGRAMMING)

    def unlock(self, level: Level) -> None:
        seed = self.good(bytes([0x27, level]))[2:]
        self.good(bytes([0x27, level + 1]) + KEY.answer(level, seed))

    def announce(self, raw: bytes) -> int:
        answer = self.good(b"\x31\x01\xff\x00" + len(raw).to_bytes(4, "big") + sha256(raw).digest())
        return int.from_bytes(answer[4:], "big")

    def blocks(self, raw: bytes, offset: int, size: int = 4064) -> Iterator[int]:
        """Sends block by block, yielding how many bytes are there."""
        self.good(b"\x34\x00\x44" + offset.to_bytes(4, "big") + (len(raw) - offset).to_bytes(4, "big"))
        for number, at in enumerate(range(offset, len(raw), size), start=1):
            self.good(bytes([0x36, number % 256]) + raw[at : at + size])
            yield min(at + size, len(raw))
        self.good(b"\x37")

    def write(self, raw: bytes) -> Verdict:
        self.programming()
        for _ in self.blocks(raw, self.announce(raw)):
            pass
        return Verdict(self.good(b"\x31\x01\xff\x01")[4])
