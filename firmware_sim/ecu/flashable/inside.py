"""What a tester may ask of this ECU beside its store: what it says of itself, calibration, self-test, reset."""

from collections.abc import Callable, Mapping

from can_bridge.calibration.service import DIDS, CalibrationService
from can_bridge.flashing.store import Store
from can_bridge.uds.diagnostics import Long
from can_bridge.uds.programming import Inner, Programming
from can_bridge.uds.refused import Refused
from can_bridge.uds.services import Did, Nrc, Routine
from contract.errors import StillwakeError
from firmware_sim.ecu.flashable.telling import Tell, tell_routine


class Inside:
    """A `can_bridge.uds.programming.Inner`.

    Args:
        facts: values of the identifiers that do not change.
        calibration: None without a release.
        tests: the self-test of the release that runs; raises StillwakeError. None without a release.
        on_reset: called when a reset is due.
        tell: as `Supplies.tell`.
    """

    def __init__(
        self,
        facts: Mapping[Did, bytes],
        *,
        calibration: CalibrationService | None,
        tests: Callable[[], Long[None]] | None,
        on_reset: Callable[[], None],
        tell: Tell,
    ) -> None:
        self._facts, self._calibration, self._tests = facts, calibration, tests
        self._on_reset, self._tell = on_reset, tell

    def read(self, did: Did) -> bytes:
        """See `Inner`, as for the other methods."""
        if did in self._facts:
            return self._facts[did]
        return self._calibrated(did).read(did)

    def write(self, did: Did, value: bytes) -> Long[None]:
        yield from self._calibrated(did).write(did, value)
        self._tell("calibrated", f"a tester wrote {did.name.lower()}", identifier=did.name)

    def self_test(self) -> Long[bytes]:
        if self._tests is None:
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT, "no release runs")
        try:
            yield from self._tests()
        except StillwakeError as error:
            self._tell("self_test_failed", str(error))
            raise Refused(Nrc.PROGRAMMING_FAILURE, str(error)) from error
        self._tell("self_test", "self-test passed")
        return b""

    def reset(self) -> None:
        self._on_reset()

    def _calibrated(self, did: Did) -> CalibrationService:
        if self._calibration is None or did not in DIDS:
            raise Refused(Nrc.OUT_OF_RANGE)
        return self._calibration


class ToldProgramming(Programming):
    """Programming of which the log hears, and that a session's end after an announcement resets.

    A tester that goes away amid a transfer would leave the jets shut until the next power-on; the release that ran
    before is in order, and a transfer that was interrupted goes on after a reset.

    Args:
        tell: as `Supplies.tell`.
    """

    def __init__(
        self,
        store: Store,
        inner: Inner,
        *,
        refusal: Callable[[], Nrc | None],
        report: Callable[[Store], bytes],
        tell: Tell,
    ) -> None:
        super().__init__(store, inner, refusal=refusal, report=report)
        self._on_leaving, self._tell = inner.reset, tell

    def leave(self) -> None:
        super().leave()
        if self.is_updating:
            self._on_leaving()

    def routine(self, routine: Routine, option: bytes) -> Long[bytes]:
        answer = yield from super().routine(routine, option)
        tell_routine(self._tell, routine, answer)
        return answer
