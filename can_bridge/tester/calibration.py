"""The steps of an ECU's calibration through UDS, with a connected client: read, change, read back, store."""

from dataclasses import dataclass

from can_bridge.flashing.state import Level
from can_bridge.tester.asking import Asking
from can_bridge.tester.messages import in_good_state, refusal_means
from can_bridge.uds.calibration_service import REVERT, STORE
from can_bridge.uds.services import Did, Nrc, Session
from contract.controller.calibration import PACKED_BYTES, Calibration, CalibrationLimits
from contract.errors import ConfigError, FlashError


@dataclass(frozen=True, kw_only=True)
class Calibrated:
    """The calibration that an ECU reports, with the precision of float32: the values in force from the ECU's next
    control period on, their limits, the release's own values, and whether values are stored in non-volatile memory."""

    in_force: Calibration
    limits: CalibrationLimits
    release: Calibration
    is_stored: bool


def read(asking: Asking) -> Calibrated:
    """Read the calibration, in any session; raises FlashError for an ECU without values to calibrate."""
    missing = FlashError("the ECU has no calibration: no release runs in it; flash a release")
    with refusal_means(Nrc.OUT_OF_RANGE, missing):
        in_force, of_release = asking.read(Did.CALIBRATION), asking.read(Did.CALIBRATION_LIMITS)
        is_stored = asking.read(Did.CALIBRATION_STORED) == STORE
    try:
        if len(of_release) != 3 * PACKED_BYTES:
            raise ConfigError(f"its limits have {len(of_release)} bytes: must have {3 * PACKED_BYTES}")
        least, greatest, release = (
            Calibration.unpack(of_release[start : start + PACKED_BYTES])
            for start in range(0, len(of_release), PACKED_BYTES)
        )
        limits = CalibrationLimits(least=least, greatest=greatest)
        return Calibrated(in_force=Calibration.unpack(in_force), limits=limits, release=release, is_stored=is_stored)
    except ConfigError as error:
        raise FlashError(f"the ECU has a calibration of another version of stillwake ({error})") from error


def unlock(asking: Asking) -> None:
    """Enter the extended session and unlock the calibration level, so that values can be written."""
    asking.session(Session.EXTENDED)
    asking.unlock(Level.CALIBRATION)


def write(asking: Asking, wanted: Calibration) -> None:
    """Put values in force, after `unlock`. Raises FlashError if the ECU refuses them, or then reports other values."""
    asking.write(Did.CALIBRATION, wanted.pack())
    _check_in_force(asking, wanted.pack())


def store(asking: Asking) -> None:
    """Store the values in force in non-volatile memory, after `unlock`. Raises NotNowError while jets are enabled."""
    _keep(asking, STORE, "store the calibration")


def revert(asking: Asking, release: Calibration) -> None:
    """Put the release's values in force and delete stored values, after `unlock`. Raises NotNowError like `store`."""
    _keep(asking, REVERT, "drop the stored calibration")
    _check_in_force(asking, release.pack())


def _keep(asking: Asking, value: bytes, step: str) -> None:
    with in_good_state(step, "its jets are enabled; the present values stay in force"):
        asking.write(Did.CALIBRATION_STORED, value)


def _check_in_force(asking: Asking, wanted: bytes) -> None:
    if asking.read(Did.CALIBRATION) != wanted:
        raise FlashError(
            "the ECU's values differ from the written values: end another tool that calibrates the ECU, and try again"
        )
