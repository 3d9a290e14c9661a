"""A calibration tool at random: sound conversations, wrong keys, odd lengths, commands of every kind in any state."""

from collections.abc import Iterator
from random import Random
from typing import Final

from can_bridge.calibration.daq import MEASURED_ADDRESS, MEASURED_BYTES
from can_bridge.calibration.segment import ADDRESS
from can_bridge.calibration.xcp import Command
from can_bridge.calibration.xcp_slave import IDLE_NS
from can_bridge.flashing.state import Level
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, Frame
from contract.config.diagnosis import CanId
from contract.config.vehicle import BusConfig
from contract.controller.calibration import PACKED_BYTES
from tests.can_bridge.flashing.store_ecu import KEY
from tests.proofs.loader_in_c.node_twin import MS, Twins, frame_to

_RARE_HEX: Final = """
e400000000 e400000001 d6 d500000100 d5000100 d400000000 d400010001 d400000001 d30000000001 e20000000000 e1ff000000010020
e1ff010000000000 e1ff010000010020 e000010000000100 e000000001000100 e000000000000200 e000000000000100 de010000
"""
"""Pages are copied; a list of DAQ is allocated, filled and started, with all that can be wrong in it first."""
_VALUES: Final = (bytes(4), b"\0\0\x80\x3f", b"\x17\xb7\x51\x3c", b"\1\0\0\0", b"\0\0\xc0\x7f", b"\0\0\x80\xbf")
_SMALL: Final = (0, 0, 0, 1, 1, 2, 3, 4, 7, 8, 16, 17, 0x80, 0x83, 0xFF)


class XcpTool:
    """One tool. `share` is how often it says something in a look at diagnosis."""

    def __init__(self, bus: BusConfig, seed: str, *, share: float) -> None:
        self._bus, self._rng, self._share = bus, Random(seed), share
        self._plan: Iterator[bytes] = iter(())
        self._answer = b""
        self.heard = 0

    def frames(self, now_ns: int) -> list[Frame]:
        rng = self._rng
        if rng.random() >= self._share:
            return []
        # A few at once, and more than there are places for.
        return [self._frame(self._next(), now_ns) for _ in range(rng.choice((1, 1, 1, 1, 2, 6)))]

    def hear(self, frames: list[Frame]) -> None:
        for frame in frames:
            if frame.identifier == self._bus.diagnosis.xcp_response:
                self._answer = frame.data if frame.data[0] == 0xFF else self._answer
                self.heard += 1

    def _next(self) -> bytes:
        rng = self._rng
        if rng.random() < 0.1:
            return self._any()
        found = next(self._plan, None)
        while found is None:
            plans = (*2 * [self._unlocking], self._writing, self._paging, self._reading, *2 * [self._measuring])
            self._plan = rng.choice(plans)()
            found = next(self._plan, None)
        return found[: rng.randrange(9)] if rng.random() < 0.02 else found

    def _any(self) -> bytes:
        rng = self._rng
        command = rng.choice((*Command, rng.randrange(256)))
        data = bytes([command]) + (bytes(rng.choices(_SMALL, k=7)) if rng.random() < 0.7 else rng.randbytes(7))
        place = rng.choice((ADDRESS, MEASURED_ADDRESS)) + rng.randrange(-2, MEASURED_BYTES + 2)
        return data[:4] + place.to_bytes(4, "little") if rng.random() < 0.5 else data

    def _unlocking(self) -> Iterator[bytes]:
        yield b"\xff\x00"
        self._answer = b""
        yield b"\xf8\x00\x01"
        seed = self._answer[2:]
        yield b"\xf8\x01\x01"
        key = bytearray(KEY.answer(Level.CALIBRATION, seed + self._answer[2:]))
        if self._rng.random() < 0.1:
            key[self._rng.randrange(16)] ^= 1
        for at in (0, 6, 12):
            yield bytes([0xF7, 16 - at]) + key[at : at + 6]
        for plan in self._rng.choices((self._writing, self._paging), k=2):
            yield from plan()

    def _writing(self) -> Iterator[bytes]:
        rng = self._rng
        for _ in range(rng.randrange(1, 4)):
            at = rng.choice((4 * rng.randrange(PACKED_BYTES // 4), rng.randrange(PACKED_BYTES + 2)))
            yield b"\xf6\0\0\0" + (ADDRESS + at).to_bytes(4, "little")
            value = rng.choice(_VALUES) + rng.choice(_VALUES)
            if rng.random() < 0.5:
                yield b"\xf0\x04" + value[:4]
            else:
                cut = rng.randrange(2, 7)
                yield bytes([0xF0, cut]) + value[:cut]
                yield bytes([0xF0, 8 - cut]) + value[cut:]
        yield rng.choice((b"\xf9\x01\0\0", b"\xf9\x01\0\0", b"\xfd", b"\xfe"))

    def _paging(self) -> Iterator[bytes]:
        rng = self._rng
        yield bytes([0xEB, rng.choice((1, 2, 3, 0x83)), 0, rng.randrange(2)])
        yield bytes([0xEA, rng.choice((1, 2)), 0])
        copies = rng.random()
        if copies < 0.3:
            yield bytes([0xE4, 0, copies < 0.2, 0, copies < 0.1])

    def _reading(self) -> Iterator[bytes]:
        rng = self._rng
        if rng.random() < 0.3:
            yield b"\xff\x00"
        for _ in range(3):
            base, size = rng.choice(((ADDRESS, PACKED_BYTES), (MEASURED_ADDRESS, MEASURED_BYTES)))
            length = rng.randrange(1, 8)
            place = (base + rng.randrange(size)).to_bytes(4, "little")
            yield bytes([0xF4, length, 0, 0]) + place
            yield bytes([0xF5, length])
            yield b"\xf6\0\0\0" + base.to_bytes(4, "little")
            yield b"\xf3\0\0\0" + rng.choice((size, 4, size + 1)).to_bytes(4, "little")
        yield rng.choice((b"\xfa\x01", b"\xd7\0\0\0"))
        yield from (b"\xf5\x07", b"\xf5\x03", b"\xf5\x07")

    def _measuring(self) -> Iterator[bytes]:
        rng = self._rng
        if rng.random() < 0.5:
            yield b"\xff\x00"
        odts = rng.choice((1, 2, 3, 12, 16))
        yield from (b"\xd6", b"\xd5\0\x01\0", bytes([0xD4, 0, 0, 0, odts]))
        for odt in range(odts):
            yield bytes([0xD3, 0, 0, 0, odt, rng.choice((1, 1, 2, 3))])
        for odt in range(odts):
            yield bytes([0xE2, 0, 0, 0, odt, 0])
            for _ in range(rng.choice((0, 1, 1, 2))):
                size = rng.choice((1, 4, 4, 7))
                at = MEASURED_ADDRESS + rng.randrange(MEASURED_BYTES - size + 1)
                yield bytes([0xE1, 0xFF, size, 0]) + at.to_bytes(4, "little")
        yield b"\xe0\0\0\0\0\0\x01\0"
        yield from (b"\xde\x02\0\0", b"\xdd\x01") if rng.random() < 0.5 else (b"\xde\x01\0\0",)
        # It listens for a while, and says nothing, or little.
        yield from rng.choices((*9 * [b""], b"\xfd", b"\xdf\0\0\0", b"\xda", b"\xf4\x04\0\0\0\x01\0\x20"), k=60)
        yield rng.choice((b"\xde\0\0\0", b"\xdd\0", b"\xdd\x02", b"\xfe", b"\xfd"))

    def _frame(self, data: bytes, now_ns: int) -> Frame:
        lengths = FD_LENGTHS if self._bus.frames == "fd" else CLASSIC_LENGTHS
        if self._rng.random() < 0.3:
            # Padded; not every tool does so.
            data = data.ljust(min(n for n in lengths if n >= max(8, len(data))), b"\xcc")
        return frame_to(self._bus, data, self._bus.diagnosis.xcp_command, now_ns)


def ask_what_is_rare(twins: Twins, bus: BusConfig) -> None:
    """What a tool at random hardly ever comes to: it unlocks both ECUs, measures, and is silent for too long, twice."""
    own = bus.diagnosis.xcp_command

    def ask(data: bytes, to: CanId = own) -> bytes:
        sent = twins.service([frame_to(bus, data, to, twins.now_ns)])
        twins.now_ns += MS
        assert twins.differences == []
        return next((frame.data for frame in sent if frame.identifier == bus.diagnosis.xcp_response), b"")

    ask(b"\xff\x00", own._replace(is_extended=not own.is_extended))
    ask(b"\xff\x00")
    seed = ask(b"\xf8\x00\x01")[2:] + ask(b"\xf8\x01\x01")[2:]
    key = KEY.answer(Level.CALIBRATION, seed)
    for at in (0, 6, 12):
        answer = ask(bytes([0xF7, 16 - at]) + key[at : at + 6])
    assert answer == b"\xff\x00"
    for text in _RARE_HEX.split():
        answer = ask(bytes.fromhex(text))
    assert answer == b"\xff\x00"
    for last in (b"\xde\x00\x00\x00", b"\xfd"):
        twins.now_ns += IDLE_NS
        twins.service([])
        ask(last)
    assert twins.differences == []
