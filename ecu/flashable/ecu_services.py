"""What a tester may ask of this ECU besides its store: identification, calibration, self-test and reset."""

from collections.abc import Callable, Mapping

from can_bridge.calibration.service import DIDS, CalibrationService
from can_bridge.uds.diagnostics import Long
from can_bridge.uds.refused import Refused
from can_bridge.uds.services import Did, Nrc
from contract.errors import StillwakeError
from ecu.flashable.event_log import Log


class EcuServices:
    """A `can_bridge.uds.programming.Inner`.

    Args:
        identification: values of the identifiers that do not change.
        calibration: None without a release.
        self_test: runs the release on test windows; raises StillwakeError. None without a release.
        on_reset: called when a reset is due.
        log: as `Equipment.log`.
    """

    def __init__(
        self,
        identification: Mapping[Did, bytes],
        *,
        calibration: CalibrationService | None,
        self_test: Callable[[], Long[None]] | None,
        on_reset: Callable[[], None],
        log: Log,
    ) -> None:
        self._identification, self._calibration, self._self_test = identification, calibration, self_test
        self._on_reset, self._log = on_reset, log

    def read(self, did: Did) -> bytes:
        """See `Inner`, as for the other methods."""
        if did in self._identification:
            return self._identification[did]
        return self._calibrated(did).read(did)

    def write(self, did: Did, value: bytes) -> Long[None]:
        yield from self._calibrated(did).write(did, value)
        self._log("calibrated", f"a tester wrote {did.name.lower()}", identifier=did.name)

    def self_test(self) -> Long[bytes]:
        if self._self_test is None:
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT, "no release runs")
        try:
            yield from self._self_test()
        except StillwakeError as error:
            self._log("self_test_failed", str(error))
            raise Refused(Nrc.PROGRAMMING_FAILURE, str(error)) from error
        self._log("self_test", "self-test passed")
        return b""

    def reset(self) -> None:
        self._on_reset()

    def _calibrated(self, did: Did) -> CalibrationService:
        if self._calibration is None or did not in DIDS:
            raise Refused(Nrc.OUT_OF_RANGE)
        return self._calibration
