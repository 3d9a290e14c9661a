"""Diagnosis on the bus: ISO-TP frames in and out, and the server behind them."""

from collections.abc import Sequence
from typing import Final

from can_bridge.isotp.endpoint import Endpoint
from can_bridge.isotp.settings import IsoTpSettings, classic
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import REQUEST_ID, RESPONSE_ID
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig

MOST_FRAMES: Final = 128
"""That an ECU looks at in one call. A control period of CAN FD at 2 Mbit/s holds a third of them; the rest of a flood
is lost."""


def isotp_settings(config: BusConfig, *, receive_id: int, send_id: int) -> IsoTpSettings:
    """Settings of one end, with the frames of this bus."""
    if config.frames == "classic":
        return classic(receive_id=receive_id, send_id=send_id)
    return IsoTpSettings(receive_id=receive_id, send_id=send_id)


class DiagnosticLink:
    """After power-on.

    Args:
        config: of the bus: CAN FD or classic frames.
    """

    def __init__(self, config: BusConfig, server: UdsServer) -> None:
        self._endpoint = Endpoint(isotp_settings(config, receive_id=REQUEST_ID, send_id=RESPONSE_ID))
        self._server = server
        self._is_sending = False

    @property
    def is_busy(self) -> bool:
        """Whether there is something to do at once, without another frame; time alone may end a reception later."""
        return self._server.is_busy or self._is_sending

    def service(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """Take frames, do at most one piece of long work, and give out what is to be sent now."""
        for frame in frames:
            self._endpoint.receive(now_ns, frame)
        was_busy = self._server.is_busy
        requests = self._endpoint.take()
        for request in requests:
            self._send(self._server.request(now_ns, request))
        # A request that begins long work has done its first piece; those that come amid it do none.
        if was_busy or not (requests and self._server.is_busy):
            self._send(self._server.tick(now_ns))
        sent = self._endpoint.poll(now_ns)
        self._is_sending = bool(sent)
        return sent

    def _send(self, answers: Sequence[bytes]) -> None:
        for answer in answers:
            self._endpoint.send(answer)
