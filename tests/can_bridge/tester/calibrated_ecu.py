"""An ECU whose running release can be calibrated, behind the real server and store."""

from can_bridge.calibration.segment import Segment
from can_bridge.flashing.store import Boot
from can_bridge.uds.calibration_service import CalibrationService
from can_bridge.uds.services import Nrc
from contract.config.controller import CostWeights
from contract.controller.calibration import Calibration, CalibrationLimits
from tests.can_bridge.flashing.releases import digest_of, provisioned
from tests.can_bridge.flashing.store_ecu import StoreEcu

# 0.07 is less as float32, 0.075 is more.
OWN = Calibration(weights=CostWeights(), action_limit=0.07, command_step=0.075, delay_steps=0)
LIMITS = CalibrationLimits(
    least=Calibration.of([0.0] * 8 + [0.01, 0.01, 0.0]), greatest=Calibration.of([10.0] * 8 + [0.07, 0.075, 3.0])
)


class Ecu(StoreEcu):
    """Attributes: `jets`, whether they run; `has_release`, whether anything can be calibrated; `buses`, interface,
    channel and frames of each that it was asked on."""

    def __init__(self) -> None:
        self.jets, self.has_release = False, True
        self.buses: list[tuple[str, str, str]] = []
        memory = provisioned()
        super().__init__(lambda: memory)

    def calibration(self, boot: Boot) -> CalibrationService | None:
        self.segment = Segment(OWN, LIMITS)
        self.service = CalibrationService(
            self.segment,
            kept=lambda: self.store.calibration(digest_of(boot)),
            keep=self.store.keep_calibration,
            refusal=lambda: Nrc.CONDITIONS_NOT_CORRECT if self.jets else None,
        )
        self.service.restore()
        return self.service if self.has_release else None
