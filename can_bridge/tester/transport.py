"""A CAN connection for udsoncan: ISO-TP by can-isotp over the buses of `can_bridge.bus`. Needs the extra `flash`.

There is no thread. An ECU only answers requests, so the bus is read only while a request is sent or its answer is
awaited. Late or repeated responses to an earlier request are dropped.
"""

import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from udsoncan.client import Client
from udsoncan.connections import BaseConnection
from udsoncan.exceptions import TimeoutException

import isotp
from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.isotp.control_info import PADDING
from can_bridge.uds.fault_memory import CODE_BYTES, FaultReport
from can_bridge.uds.services import MAX_REQUEST, NEGATIVE, POSITIVE, Service
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError

_SAME: Final[Mapping[int, slice]] = {
    **dict.fromkeys((Service.SESSION, Service.RESET, Service.REPORT_FAULTS, Service.SECURITY), slice(1, 2)),
    **dict.fromkeys((Service.COMMUNICATION, Service.TRANSFER, Service.TESTER_PRESENT), slice(1, 2)),
    **dict.fromkeys((Service.READ, Service.WRITE), slice(1, 3)),
    **{Service.FAULT_SETTING: slice(1, 2), Service.ROUTINE: slice(1, 4)},
}
"""Bytes of a request that a positive response repeats at the same place: sub-function, identifier or block counter."""


def answers(request: bytes, response: bytes) -> bool:
    """Return whether a response can belong to this request."""
    if not request or not response:
        return False
    if response[0] == NEGATIVE:
        return len(response) >= 3 and response[1] == request[0]
    same = _SAME.get(request[0])
    if request[0] == Service.REPORT_FAULTS and request[1] in (FaultReport.SNAPSHOT, FaultReport.EXTENDED):
        same = slice(1, 2 + CODE_BYTES)  # the trouble code, too
    return response[0] == request[0] + POSITIVE and (same is None or request[same] == response[same])


SEND_S: Final = 10.0
"""Longest time in s to send a request: 4 kB take 0.3 s on classic CAN at 500 kbit/s, and more with other traffic."""
FRAME_S: Final = 1.0
"""Longest time in s to send one frame: while other nodes send, a CAN controller's queue may stay full."""
_TURN_S: Final = 0.02
FLOW_CONTROL_MS: Final = 1000
"""Timeout in ms for a flow control frame (N_Bs), and for the next consecutive frame (N_Cr) (ISO 15765-2)."""
_ENDS_SENDING: Final = (isotp.FlowControlTimeoutError, isotp.OverflowError, isotp.MaximumWaitFrameReachedError)


def silence() -> None:
    """Suppress the libraries' warnings, which Python prints on stderr if a logger has no handler."""
    for name in ("UdsClient", "Connection", "isotp"):
        logging.getLogger(name).addHandler(logging.NullHandler())


@contextmanager
def open_client(config: BusConfig) -> Iterator[Client]:
    """Yield a client for the ECU on a bus; raises BusError as `PythonCanBus.open` does."""
    silence()
    with (
        PythonCanBus.open(config, accept={config.diagnosis.response}) as bus,
        Client(BusConnection(bus, config)) as client,
    ):
        yield client


class BusConnection(BaseConnection):
    """An ISO-TP connection over an open bus; the caller that opened the bus closes it."""

    def __init__(self, bus: PythonCanBus, config: BusConfig) -> None:
        super().__init__()
        is_fd, request, response = config.frames == "fd", config.diagnosis.request, config.diagnosis.response
        mode = isotp.AddressingMode.Normal_29bits if request.is_extended else isotp.AddressingMode.Normal_11bits
        self._bus = bus
        self._request = b""
        self._failed = False
        self._layer: Any = isotp.TransportLayerLogic(
            rxfn=self._receive_frame,
            txfn=self._send_frame,
            address=isotp.Address(mode, txid=request.number, rxid=response.number),
            error_handler=self._note,
            params={
                "stmin": 0,
                "blocksize": 0,
                "can_fd": is_fd,
                "bitrate_switch": is_fd,
                "tx_data_length": 64 if is_fd else 8,
                "tx_data_min_length": 8,
                "tx_padding": PADDING,
                "max_frame_size": MAX_REQUEST,
                "wftmax": 100,
                "rx_flowcontrol_timeout": FLOW_CONTROL_MS,
                "rx_consecutive_frame_timeout": FLOW_CONTROL_MS,
            },
        )

    def open(self) -> "BusConnection":
        return self

    def close(self) -> None: ...

    def is_open(self) -> bool:
        return True

    def empty_rxqueue(self) -> None:
        self._bus.receive_all()
        self._layer.reset()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        """Send a request. Raises TimeoutException if the ECU accepts only a part of it, BusError if the bus fails."""
        self._request, self._failed = payload, False
        self._layer.send(payload)
        until = time.monotonic() + SEND_S
        while self._layer.transmitting():
            self._layer.process(rx_timeout=_TURN_S)
            if time.monotonic() > until:
                self._layer.stop_sending()
                self._failed = True
        if self._failed:
            raise TimeoutException("the ECU accepted only a part of the request")  # type: ignore[no-untyped-call]

    def specific_wait_frame(self, timeout: float | None = None) -> bytes:
        """Return the next payload that can be the answer; raises TimeoutException after `timeout` seconds."""
        until = time.monotonic() + (timeout or 0.0)
        while True:
            while self._layer.available():
                payload = bytes(self._layer.recv())
                if answers(self._request, payload):
                    return payload
            left = until - time.monotonic()
            if left <= 0.0:
                raise TimeoutException("no answer")  # type: ignore[no-untyped-call]
            self._layer.process(rx_timeout=min(left, _TURN_S))

    def _receive_frame(self, timeout: float) -> isotp.CanMessage | None:
        # A complete payload is returned before the bus is read again.
        frame = None if self._layer.available() else self._bus.receive(timeout)
        if frame is None:
            return None
        return isotp.CanMessage(
            arbitration_id=frame.frame_id, data=frame.data, is_fd=frame.is_fd, extended_id=frame.is_extended
        )

    def _send_frame(self, message: isotp.CanMessage) -> None:
        frame = Frame(
            frame_id=message.arbitration_id,
            data=bytes(message.data),
            is_fd=message.is_fd,
            is_extended=message.is_extended_id,
        )
        until = time.monotonic() + FRAME_S
        while True:
            try:
                self._bus.send(frame, timeout_s=_TURN_S)
                return
            except BusError:
                if time.monotonic() >= until:
                    raise
                # Some drivers return immediately if the queue is full, so there is a pause before the next attempt.
                time.sleep(0.001)

    def _note(self, error: Exception) -> None:
        # Only the errors in `_ENDS_SENDING` end the transmission; a repeated flow control frame does not.
        self._failed |= isinstance(error, _ENDS_SENDING)
