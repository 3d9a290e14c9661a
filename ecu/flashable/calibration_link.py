"""Calibration of the release that runs: its segment, by UDS and by XCP, and what is stored of it."""

from collections.abc import Callable, Sequence

from can_bridge.calibration.segment import Segment
from can_bridge.calibration.xcp_slave import XcpSlave
from can_bridge.flashing.store import Store
from can_bridge.uds.calibration_service import CalibrationService
from can_bridge.uds.services import Nrc, Refused
from can_bridge.wire.frame import Frame
from contract.config.tree import Config
from contract.release.checks import Bundle
from ecu.calibrating import limits_of
from ecu.flashable.equipment import Equipment
from ecu.stepped import CalibratedEcu


class CalibrationLink:
    """Calibrates the ECU of one release, from its boot on, whatever computes it.

    Args:
        bundle: that runs.
        ecu: that runs it.
        refusal: why nothing may be stored now; values in force can always be changed.
    """

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
        self._is_fd, self._response = config.bus.frames == "fd", config.bus.diagnosis.xcp_response
        self._xcp = XcpSlave(self._segment, equipment.access, equipment.random_bytes)
        self.service = CalibrationService(
            self._segment,
            kept=lambda: store.records.calibration(bundle.digest),
            keep=store.keep_calibration,
            refusal=refusal,
        )
        if (error := self.service.restore()) is not None:
            equipment.log("calibration_dropped", f"stored calibration not used: {error}")

    def hand_over(self) -> None:
        """At the beginning of a control period: give the ECU other values, if others are in force now."""
        if (calibration := self._segment.take()) is not None:
            self._ecu.calibrate(calibration)

    def xcp(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """Take the tool's frames; those to it. Storing that is asked for waits until it is allowed."""
        packets = [packet for frame in frames for packet in self._xcp.command(now_ns, frame.data)]
        if (calibration := self._xcp.to_store(now_ns)) is not None:
            try:
                self.service.store(calibration)
            except Refused as refused:
                if refused.code is not Nrc.CONDITIONS_NOT_CORRECT:
                    # To try again in every period would wear out a memory that fails.
                    self._xcp.not_stored()
            else:
                packets += self._xcp.stored()
        number, is_extended = self._response
        return [
            Frame(
                frame_id=number,
                data=packet,
                timestamp_ns=max(0, now_ns),
                is_fd=self._is_fd,
                is_extended=is_extended,
            )
            for packet in packets
        ]
