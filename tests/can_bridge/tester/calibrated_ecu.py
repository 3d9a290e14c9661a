"""An ECU with nothing but a calibration behind the real server."""

from can_bridge.calibration.segment import Segment
from can_bridge.uds.calibration_service import CalibrationService
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Did, Nrc, Refused, Session
from contract.config.controller import CostWeights
from contract.controller.calibration import Calibration, CalibrationLimits
from tests.can_bridge.flashing.store_ecu import KEY, Counted

# 0.07 is less as float32, 0.075 is more.
OWN = Calibration(weights=CostWeights(), action_limit=0.07, command_step=0.075, delay_steps=0)
LIMITS = CalibrationLimits(
    least=Calibration.of([0.0] * 8 + [0.01, 0.01, 0.0]), greatest=Calibration.of([10.0] * 8 + [0.07, 0.075, 3.0])
)


class Ecu:
    """What is around the server: a segment, a record, and jets."""

    is_reset = False

    def __init__(self) -> None:
        self.raw: bytes | None = None
        self.jets = False
        self.has_release = True
        self.attempts = 0
        self.buses: list[tuple[str, str, str]] = []
        """Interface, channel and frames of each that it was asked on."""
        self.power_on()

    def power_on(self) -> None:
        self.segment = Segment(OWN, LIMITS)
        self.service = CalibrationService(
            self.segment,
            kept=lambda: self.raw,
            keep=lambda raw: setattr(self, "raw", raw),
            refusal=lambda: Nrc.CONDITIONS_NOT_CORRECT if self.jets else None,
        )
        self.service.restore()
        self.server = UdsServer(self, KEY, Counted())  # type: ignore[arg-type]

    def enter(self, session: Session) -> None: ...

    def leave(self) -> None: ...

    def read(self, did: Did) -> bytes:
        if not self.has_release:
            raise Refused(Nrc.OUT_OF_RANGE)
        return self.service.read(did)

    def write(self, did: Did, value: bytes) -> None:
        self.service.write(did, value)

    def failed_attempts(self, level) -> int:
        return self.attempts

    def keep_failed_attempts(self, level, count: int) -> None:
        self.attempts = count
