"""ECUs with the real server, services and store: one to flash, and one whose running release can be calibrated."""

from can_bridge.calibration.segment import Segment
from can_bridge.flashing.store import Boot
from can_bridge.uds.calibration_service import CalibrationService
from can_bridge.uds.services import Nrc
from contract.config.controller import CostWeights
from contract.controller.calibration import Calibration, CalibrationLimits
from contract.release import bundle
from contract.release.container import image_of, read_files
from contract.release.signing import PublicKey
from contract.shipped import BUNDLE
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import RELEASE, digest_of, image, keys, name_of, provision, provisioned
from tests.can_bridge.flashing.store_ecu import StoreEcu

SHIPPED = image_of(read_files(BUNDLE))
SHIPPED_BY = bundle.load(BUNDLE).signer or PublicKey(b"")

# 0.07 is less as float32, 0.075 is more.
OWN = Calibration(weights=CostWeights(), action_limit=0.07, command_step=0.075, delay_steps=0)
LIMITS = CalibrationLimits(
    least=Calibration.of([0.0] * 8 + [0.01, 0.01, 0.0]), greatest=Calibration.of([10.0] * 8 + [0.07, 0.075, 3.0])
)


class EcuToFlash(StoreEcu):
    """Release `old` is confirmed; the tests' key and that of the shipped release may sign; `memory` outlives resets."""

    def __init__(self, first: bytes | None = image("old")) -> None:
        self.memory = provision(PlainBacking(), first, keys(1, RELEASE, SHIPPED_BY))
        self.memory.written = 0
        super().__init__(lambda: self.memory)

    @property
    def runs(self) -> str | None:
        return name_of(self.boot)


class Ecu(StoreEcu):
    """`jets`: whether they run; `has_release`: whether anything can be calibrated; `buses`: interface, channel and
    frames of each bus on which it was asked."""

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
