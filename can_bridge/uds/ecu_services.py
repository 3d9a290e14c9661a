"""The ECU's diagnostic services, which act on its store of releases; `can_bridge.uds.server` calls them.

The answer to the routine ERASE has the offset of the first byte to send (4 bytes). The answer to CHECK has a `Verdict`
(1 byte). Answers to the other routines are empty. A repeated request gets the same answer again, because the tester may
not have received the first answer.
"""

from collections.abc import Callable, Mapping
from itertools import repeat
from typing import Final

from can_bridge.flashing import report
from can_bridge.flashing.backing import Long
from can_bridge.flashing.state import Level, SlotPhase
from can_bridge.flashing.store import Store
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.calibration_service import CalibrationService, as_refusals
from can_bridge.uds.services import Did, Nrc, Refused, Routine, Session
from contract.errors import StillwakeError

WRITTEN: Final = 512
"""Number of bytes of an image that are written in one part of a long operation."""
_DONE: Final = {
    Routine.ERASE: ("update", "a release is being written: jets shut until a reset"),
    Routine.ACTIVATE: ("activated", "the written release is activated: it boots on trial at the next reset"),
    Routine.CONFIRM: ("confirmed", "the running release is confirmed"),
    Routine.REVERT: ("given_up", "the previous release boots at the next reset"),
}
"""Events of the ECU's log and their texts, by routine."""


class EcuServices:
    """The services of an ECU after a boot; each may raise `Refused`. The server has already checked session, security
    level, and the lengths stated in `services`.

    Args:
        identification: values of the constant identifiers.
        calibration: service for the calibration; None without a release.
        self_test: runs the release on test windows; raises StillwakeError if the test fails. None without a release.
        refusal: returns the reason why the ECU may not be programmed now, or None.
        on_reset: resets the ECU; called after the request was answered.
        log: called with an event's name, its text, and its fields.

    Attributes:
        is_updating: whether an image was announced since power-on; the jets then stay shut until a reset.
    """

    def __init__(
        self,
        store: Store,
        identification: Mapping[Did, bytes],
        *,
        calibration: CalibrationService | None,
        self_test: Callable[[], Long[None]] | None,
        refusal: Callable[[], Nrc | None],
        on_reset: Callable[[], None],
        log: Callable[..., None],
    ) -> None:
        self._store = store
        self._identification, self._calibration, self._self_test = identification, calibration, self_test
        self._refusal, self.reset, self._log = refusal, on_reset, log
        self._announced_length = 0
        self.is_updating = False
        self._has_passed = self._has_confirmed = False
        self._taken_keys = b""

    def enter(self, session: Session) -> None:
        if session is Session.PROGRAMMING:
            self._check_preconditions()

    def leave(self) -> None:
        """Interrupt a transfer in progress, because the session ended; the transfer can be resumed."""
        self._store.drop()
        if self.is_updating:
            # The reset starts the old release. Without the reset, the jets would stay shut until the next power-on.
            self.reset()

    def read(self, did: Did) -> bytes:
        """Return the value of an identifier; raises OUT_OF_RANGE if the identifier has no value."""
        if did is Did.CAPACITY:
            return self._store.backing.capacity.to_bytes(4, "big")
        if did is Did.KEY_LIST:
            return (self._store.keys.version if self._store.keys else 0).to_bytes(4, "big")
        if did is Did.STORE:
            return report.encode(self._store)
        if did in self._identification:
            return self._identification[did]
        return self._of_release().read(did)

    def write(self, did: Did, value: bytes) -> None:
        """Write an identifier; raises OUT_OF_RANGE for a value that is not allowed."""
        if did is not Did.KEY_LIST:
            self._of_release().write(did, value)
            self._log("calibrated", f"a tester wrote {did.name.lower()}", identifier=did.name)
            return
        if value == self._taken_keys:
            return
        # A microcontroller verifies a signature in milliseconds, so the conditions for programming must be met.
        self._check_preconditions()
        with as_refusals():
            self._store.take_keys(value)
        self._taken_keys = value

    def routine(self, routine: Routine, option: bytes) -> Long[bytes]:
        status = b""
        with as_refusals():
            if routine is Routine.PRECONDITIONS:
                self._check_preconditions()
            elif routine is Routine.ERASE:
                self._check_preconditions()
                self.is_updating, self._has_passed, self._has_confirmed = True, False, False
                length = int.from_bytes(option[:4], "big")
                offset = yield from self._store.announce(length, option[4:])
                self._announced_length = length
                status = offset.to_bytes(4, "big")
            elif routine is Routine.CHECK:
                verdict = yield from self._store.finish()
                status = bytes([verdict])
                self._log("checked", f"the written release: {verdict.in_words}", verdict=verdict.name)
            elif routine is Routine.ACTIVATE:
                self._store.activate()
            elif routine is Routine.SELF_TEST:
                yield from self._run_self_test()
            elif routine is Routine.CONFIRM:
                self._confirm()
            elif routine is Routine.REVERT:
                self._check_preconditions()
                verdict = yield from self._store.revert()
                if verdict != Verdict.GOOD:
                    raise Refused(Nrc.CONDITIONS_NOT_CORRECT, f"the previous release: {verdict.in_words}")
        if routine in _DONE:
            self._log(*_DONE[routine])
        return status

    def download(self, offset: int, length: int) -> None:
        """Expect `length` bytes of the announced image, beginning at byte `offset`."""
        if self._store.received is None:
            raise Refused(Nrc.SEQUENCE_ERROR, "no image is announced")
        if offset != self._store.received or offset + length != self._announced_length:
            raise Refused(Nrc.OUT_OF_RANGE, f"bytes {offset}..{offset + length} are not the missing bytes")

    def transfer(self, data: bytes) -> Long[None]:
        with as_refusals():
            self._store.append(data)
        # All data are written already. The operation still has as many parts as a write to flash memory would have.
        yield from repeat(None, (len(data) - 1) // WRITTEN)

    def failed_attempts(self, level: Level) -> int:
        """Return the number of consecutive wrong keys. This number survives resets."""
        return self._store.state.failed_attempts[level]

    def keep_failed_attempts(self, level: Level, count: int) -> None:
        with as_refusals():
            self._store.keep_failed_attempts(level, count)

    def before_reset(self) -> None:
        """Check that control did not begin during the session: a reset, or the end of messages, would interrupt it."""
        if not self.is_updating:
            self._check_preconditions()

    def _of_release(self) -> CalibrationService:
        if self._calibration is None:
            raise Refused(Nrc.OUT_OF_RANGE)
        return self._calibration

    def _check_preconditions(self) -> None:
        if (code := self._refusal()) is not None:
            raise Refused(code)

    def _run_self_test(self) -> Long[None]:
        self._has_passed = False
        if self._self_test is None:
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT, "no release runs")
        try:
            yield from self._self_test()
        except StillwakeError as error:
            self._log("self_test_failed", str(error))
            raise Refused(Nrc.PROGRAMMING_FAILURE, str(error)) from error
        self._log("self_test", "self-test passed")
        self._has_passed = True

    def _confirm(self) -> None:
        running = self._store.running
        if running is not None and self._store.state.slots[running].phase == SlotPhase.TRIAL:
            if not self._has_passed:
                raise Refused(Nrc.SEQUENCE_ERROR, "the release on trial did not pass its self-test since this boot")
            self._store.confirm()
            self._has_confirmed = True
        elif not self._has_confirmed:
            # A tester that confirms now assumes that the release that it sent is running, but no release runs on trial.
            raise Refused(Nrc.SEQUENCE_ERROR, "no release runs on trial")
