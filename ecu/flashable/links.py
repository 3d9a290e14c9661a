"""The links of a tester on the bus: to the server of diagnosis, and to the calibration of the running release.

A functional request goes to every ECU. It must fit into one frame (ISO 15765-2, table 4), because a longer request
would need flow control. A functional request does not interrupt a physical request to this ECU.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Final

from can_bridge.calibration.daq import measured_bytes
from can_bridge.calibration.segment import Segment
from can_bridge.calibration.xcp_slave import XcpSlave
from can_bridge.flashing.store import Store
from can_bridge.isotp import control_info
from can_bridge.isotp.endpoint import Endpoint, IsoTpSettings
from can_bridge.uds.calibration_service import CalibrationService
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import BESIDE, Nrc, Refused
from can_bridge.wire.frame import Frame
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.release.checks import Bundle
from ecu.calibrating import limits_of
from ecu.ecu_state import EcuState
from ecu.flashable.equipment import Equipment
from ecu.stepped import CalibratedEcu

XCP_PLACES: Final = 4
"""Largest number of packets that wait to be sent to a tool. While so many wait, commands from the tool are lost."""
MOST_FRAMES: Final = 128
"""Largest number of frames that the ECU processes in one call; further frames are lost. In one control period, a CAN FD
bus at 2 Mbit/s carries at most a third of this number."""


def isotp_settings(config: BusConfig, *, is_tester: bool = False) -> IsoTpSettings:
    """Return the ISO-TP settings of the ECU, or of the tester: frame format and identifiers of this bus."""
    own, other = config.diagnosis.response, config.diagnosis.request
    if is_tester:
        own, other = other, own
    is_fd, length = (True, 64) if config.frames == "fd" else (False, 8)
    return IsoTpSettings(
        receive_id=other.number, send_id=own.number, is_extended=own.is_extended, is_fd=is_fd, frame_length=length
    )


class DiagnosticLink:
    """The link between a tester and the server of diagnosis; a new object is in the state after power-on."""

    def __init__(self, config: BusConfig, server: UdsServer) -> None:
        self._settings, self._functional = isotp_settings(config), config.diagnosis.functional
        self._endpoint, self._server = Endpoint(self._settings), server
        self._sent = 0

    @property
    def is_working(self) -> bool:
        return self._server.is_busy

    @property
    def room(self) -> int:
        """Number of frames that other links may still send after this link's latest call."""
        return self._settings.burst - self._sent

    @property
    def is_busy(self) -> bool:
        """Whether work remains even if no further frame arrives. The timeout of a reception does not count as work."""
        return self._server.is_busy or self._sent > 0

    def service(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """Process frames, do at most one part of a long operation, and return the frames to send now."""
        self._server.look(now_ns, in_transit=self._endpoint.is_receiving or self._endpoint.is_sending)
        was_busy, requests = self._server.is_busy, 0
        for request, is_functional in self._requests(now_ns, frames):
            # Requests are lost if there are too many of them, or no place is free for an answer.
            if requests < self._settings.queue and not self._endpoint.is_full:
                is_occupied = self._endpoint.occupied > BESIDE
                self._send(self._server.request(now_ns, request, is_functional=is_functional, is_occupied=is_occupied))
            requests += 1
        # A request that began a long operation has already done the operation's first part, so `tick` is not called.
        if was_busy or not (requests and self._server.is_busy):
            self._send(self._server.tick(now_ns))
        sent = self._endpoint.poll(now_ns)
        self._sent = len(sent)
        return sent

    def _requests(self, now_ns: int, frames: Sequence[Frame]) -> Iterator[tuple[bytes, bool]]:
        for frame in frames:
            if frame.identifier == self._functional:
                part = control_info.parse(frame.data)
                if isinstance(part, control_info.Single):
                    yield part.data, True
            else:
                self._endpoint.is_held = self._server.is_writing
                self._endpoint.receive(now_ns, frame)
                yield from ((request, False) for request in self._endpoint.take())

    def _send(self, answers: Sequence[bytes]) -> None:
        for answer in answers:
            self._endpoint.send(answer)


class CalibrationLink:
    """The link that calibrates an ECU, created when a release is booted. `refusal` returns the reason why values may
    not be stored now, or None. The values in force can always be changed."""

    def __init__(
        self,
        bundle: Bundle,
        ecu: CalibratedEcu,
        store: Store,
        config: Config,
        equipment: Equipment,
        *,
        refusal: Callable[[], Nrc | None],
    ) -> None:
        self._ecu = ecu
        self._segment = Segment(ecu.calibration, limits_of(bundle, config))
        diagnosis = config.bus.diagnosis
        self._is_fd, self._response = config.bus.frames == "fd", diagnosis.xcp_response
        self._xcp: XcpSlave | None = None
        if diagnosis.xcp:
            answer = equipment.access.answer
            self._xcp = XcpSlave(self._segment, answer, equipment.random_bytes, period_ns=config.period_ns)
        self._waiting, self.is_sending = list[bytes](), False
        self.service = CalibrationService(
            self._segment, kept=lambda: store.calibration(bundle.digest), keep=store.keep_calibration, refusal=refusal
        )
        if (error := self.service.restore()) is not None:
            equipment.log("calibration_dropped", f"stored calibration not used: {error}")

    def hand_over(self) -> None:
        """Calibrate the ECU at the beginning of a control period if a tool or a tester has set new values."""
        if (calibration := self._segment.take()) is not None:
            self._ecu.calibrate(calibration)

    @property
    def is_measuring(self) -> bool:
        """Whether a tool receives the values of each control period."""
        return self._xcp is not None and self._xcp.daq.is_running

    def sample(self, state: EcuState) -> None:
        """Pass the measured values of the latest period to the tool's measurement; the control loop calls this."""
        if self._xcp is None:
            return
        measured = measured_bytes(
            state.memory.window[-1],
            self._ecu.trace.action,
            mode=state.fail_safe.mode.on_wire,
            reason=state.fail_safe.reason,
            gated=self._ecu.trace.interventions.value,
            calibration=self._ecu.calibration,
            correction=state.speed.air.correction,
        )
        self._xcp.daq.sample(measured)

    def xcp(self, now_ns: int, frames: Sequence[Frame], *, room: int, may_store: bool) -> list[Frame]:
        """Process the tool's frames and return at most `room` frames to it. A request to store values waits until UDS
        is idle (`may_store`), no jet may run, and a place is free for the answer."""
        if self._xcp is None:
            return []
        self._xcp.daq.look()
        for frame in frames:
            if len(self._waiting) < XCP_PLACES:
                self._waiting += self._xcp.command(now_ns, frame.data)
        calibration = self._xcp.to_store(now_ns)
        if calibration is not None and may_store and len(self._waiting) < XCP_PLACES:
            try:
                self.service.store(calibration)
            except Refused as refused:
                if refused.code is not Nrc.CONDITIONS_NOT_CORRECT:
                    # Without this call, an attempt in every period would wear out a failing memory.
                    self._xcp.not_stored()
            else:
                self._waiting += self._xcp.stored()
        packets, self._waiting = self._waiting[:room], self._waiting[room:]
        packets += self._xcp.daq.packets(room - len(packets))
        self.is_sending = bool(packets)
        (number, is_extended), sent_ns = self._response, max(0, now_ns)
        return [
            Frame(frame_id=number, data=packet, timestamp_ns=sent_ns, is_fd=self._is_fd, is_extended=is_extended)
            for packet in packets
        ]
