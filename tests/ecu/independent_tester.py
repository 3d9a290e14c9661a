"""Testers that share no code with ours: udsoncan over can-isotp, in the time of what they talk to."""

from collections import deque
from collections.abc import Callable
from itertools import count
from typing import Any, Final

import isotp
from udsoncan.client import Client

from can_bridge.wire.frame import Frame
from contract.config.diagnosis import DiagnosisConfig
from tests.can_bridge.flashing.store_ecu import KEY
from tests.can_bridge.tester.line import DirectConnection

_NORMAL: Final = isotp.AddressingMode.Normal_11bits
_FIXED: Final = isotp.AddressingMode.NormalFixed_29bits
_NAMES: Final = ("request_id", "response_id", "functional_id", "xcp_command_id", "xcp_response_id")


def _ids(*numbers: int) -> DiagnosisConfig:
    given: dict[str, Any] = dict(zip(_NAMES, numbers, strict=True))
    return DiagnosisConfig(**given)


_SHORT: Final = _ids(0x6A1, 0x6A9, 0x7DF, 0x6B1, 0x6B9)
_LONG: Final = _ids(0x18DA5AF1, 0x18DAF15A, 0x18DB33F1, 0x18EF5AF1, 0x18EFF15A)
ADDRESSED: Final = (
    (_SHORT, isotp.Address(_NORMAL, txid=0x6A1, rxid=0x6A9), isotp.Address(_NORMAL, txid=0x7DF, rxid=0x6A9)),
    # can-isotp makes the identifiers of ISO 15765-2's normal fixed addressing out of addresses.
    (
        _LONG,
        isotp.Address(_FIXED, target_address=0x5A, source_address=0xF1),
        isotp.Address(_FIXED, target_address=0x33, source_address=0xF1),
    ),
)
"""Settings, and the same as can-isotp knows them: physical, functional."""

Exchange = Callable[[list[Frame]], list[Frame]]
"""Frames to the ECU, and what it sends in the millisecond after that."""


class IndependentTester(DirectConnection):
    def __init__(self, exchange: Exchange, physical: isotp.Address, functional: isotp.Address, *, is_fd: bool) -> None:
        super().__init__()
        self.exchange, self._in, self._out = exchange, deque[isotp.CanMessage](), list[isotp.CanMessage]()
        params = {"can_fd": is_fd, "tx_data_length": 64 if is_fd else 8, "tx_padding": 0xCC}
        self._layer, self._all = (
            isotp.TransportLayerLogic(
                rxfn=lambda timeout: self._in.popleft() if self._in else None,
                txfn=self._out.append,
                address=address,
                params=params,
            )
            for address in (physical, functional)
        )

    def empty_rxqueue(self) -> None:
        self._in.clear()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        self._layer.send(payload)

    def specific_wait_frame(self, timeout: float | None = None) -> bytes:
        return next(found for _ in range(5000) if (found := self.tick()) is not None)

    def tick(self) -> bytes | None:
        """A millisecond; an answer that is whole."""
        self._layer.process(rx_timeout=0.0)
        sent = [
            Frame(frame_id=one.arbitration_id, data=bytes(one.data), is_fd=one.is_fd, is_extended=one.is_extended_id)
            for one in self._out
        ]
        self._out.clear()
        for one in self.exchange(sent):
            self._in.append(isotp.CanMessage(one.frame_id, data=one.data, extended_id=one.is_extended, is_fd=one.is_fd))
        self._layer.process(rx_timeout=0.0)
        found = self._layer.recv()
        return None if found is None else bytes(found)

    def ask_all(self, payload: bytes) -> list[bytes]:
        """What comes in a tenth of a second after a functional request."""
        self._all.send(payload, target_address_type=isotp.TargetAddressType.Functional)
        self._all.process(rx_timeout=0.0)
        return [found for _ in range(100) if (found := self.tick()) is not None]


def converse(tester: IndependentTester, serial: bytes) -> None:
    """Reads, unlocks and writes, by one frame and several, in both ways of addressing."""
    with Client(tester, request_timeout=None) as client:
        client.set_configs({"p2_timeout": 60.0, "use_server_timing": False, "security_algo": KEY.answer})
        client.change_session(3)
        client.unlock_security_access(3)

        def raw(payload: bytes) -> bytes:
            tester.specific_send(payload)
            return tester.specific_wait_frame()

        values = raw(b"\x22\xfd\x10")
        assert len(values) == 3 + 44
        # Several frames to the ECU, and from it.
        assert raw(b"\x2e" + values[1:]) == b"\x6e\xfd\x10"
        assert len(raw(b"\x22\xfd\x11\xfd\x10\xf1\x8c")) == 1 + 134 + 46 + 2 + len(serial)
        assert tester.ask_all(b"\x22\xf1\x8c") == [b"\x62\xf1\x8c" + serial]
        assert tester.ask_all(b"\x3e\x00") == [b"\x7e\x00"]
        for unsent in (b"\x99\x01", b"\x10\x07", b"\x22\xff\xff", b"\x34", b"\x27\x01", b"\x3e\x80"):
            assert tester.ask_all(unsent) == [], unsent.hex()
        assert tester.ask_all(b"\x22\xf1") == [b"\x7f\x22\x13"]


def keeps_whole(tester: IndependentTester, to_all: Frame) -> None:
    """A functional request amid a physical one of several frames interrupts nothing, and is answered itself."""
    values = b"\x2e\xfd\x10" + bytes(100)
    sent, asked = count(), tester.exchange

    def amid(frames: list[Frame]) -> list[Frame]:
        return asked([to_all, *frames] if frames and next(sent) == 1 else frames)

    tester.exchange = amid
    tester.specific_send(values)
    answers = [found for _ in range(100) if (found := tester.tick()) is not None]
    tester.exchange = asked
    assert sorted(answers) == [b"\x7e\x00", b"\x7f\x2e\x13"]
