"""All that a tester may ask of this ECU: programming on its store, what it says of itself, calibration, self-test."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from can_bridge.calibration.service import DIDS, CalibrationService
from can_bridge.uds.diagnostics import Diagnostics, Long
from can_bridge.uds.refused import Refused
from can_bridge.uds.services import Did, Level, Nrc, Routine, Session
from contract.errors import StillwakeError
from firmware_sim.ecu.flashable.telling import Tell, tell_routine


@dataclass(frozen=True, kw_only=True)
class Events:
    """What the ECU around has to do.

    Attributes:
        erased: a transfer was announced: the control goes into UPDATE.
        reset: a reset was asked for.
        tell: as `Supplies.tell`.
    """

    erased: Callable[[], None]
    reset: Callable[[], None]
    tell: Tell


class NodeDiagnostics:
    """A `can_bridge.uds.diagnostics.Diagnostics`.

    Args:
        programming: does what concerns the store.
        facts: values of the identifiers that do not change.
        calibration: None without a release.
        self_test: of the release that runs; raises StillwakeError. None without a release.
        events: that the ECU around takes notice of.
    """

    def __init__(
        self,
        programming: Diagnostics,
        *,
        facts: Mapping[Did, bytes],
        calibration: CalibrationService | None,
        self_test: Callable[[], Long[None]] | None,
        events: Events,
    ) -> None:
        self._programming, self._facts, self._calibration = programming, facts, calibration
        self._self_test, self._events = self_test, events

    def enter(self, session: Session) -> None:
        """See `Diagnostics`, as for the other methods."""
        self._programming.enter(session)

    def leave(self) -> None:
        self._programming.leave()

    def read(self, did: Did) -> bytes:
        if did in self._facts:
            return self._facts[did]
        if did in DIDS:
            return self._calibrated().read(did)
        return self._programming.read(did)

    def write(self, did: Did, value: bytes) -> Long[None]:
        if did in DIDS:
            yield from self._calibrated().write(did, value)
        else:
            yield from self._programming.write(did, value)

    def routine(self, routine: Routine, option: bytes) -> Long[bytes]:
        if routine is Routine.SELF_TEST:
            return (yield from self._run_self_test())
        if routine is Routine.ERASE:
            # Before a byte is written, and for good: only a reset leads out.
            self._programming.enter(Session.PROGRAMMING)
            self._events.erased()
        answer = yield from self._programming.routine(routine, option)
        tell_routine(self._events.tell, routine, answer)
        return answer

    def download(self, offset: int, length: int) -> None:
        self._programming.download(offset, length)

    def transfer(self, data: bytes) -> Long[None]:
        return self._programming.transfer(data)

    def exit(self) -> Long[None]:
        return self._programming.exit()

    def failed_attempts(self, level: Level) -> int:
        return self._programming.failed_attempts(level)

    def keep_failed_attempts(self, level: Level, count: int) -> None:
        self._programming.keep_failed_attempts(level, count)

    def reset(self) -> None:
        self._events.reset()

    def _calibrated(self) -> CalibrationService:
        if self._calibration is None:
            raise Refused(Nrc.OUT_OF_RANGE)
        return self._calibration

    def _run_self_test(self) -> Long[bytes]:
        if self._self_test is None:
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT, "no release runs")
        try:
            yield from self._self_test()
        except StillwakeError as error:
            self._events.tell("self_test_failed", f"self-test failed: {error}")
            raise Refused(Nrc.PROGRAMMING_FAILURE, str(error)) from error
        self._events.tell("self_test", "self-test passed")
        return b""
