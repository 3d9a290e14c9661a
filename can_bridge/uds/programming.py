"""The programming part of what the UDS server asks of the ECU, over the store of releases.

What the store has no part in, identifiers of the vehicle, calibration and the self-test, is the job of an `Inner`.
Answers of the routines: ERASE has the wanted offset (4), CHECK a `Verdict` (1); the others are empty, but for the
self-test's, which is the inner one's. A request that was carried out already is answered alike when it comes again,
because the tester may have missed the first answer.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import repeat
from typing import Final, Protocol

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.medium import MediumError
from can_bridge.flashing.state import Phase
from can_bridge.flashing.store import OutOfOrderError, Store
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.diagnostics import Long
from can_bridge.uds.refused import Refused
from can_bridge.uds.services import Did, Nrc, Routine, Session
from contract.errors import ConfigError, KeyFileError

WRITTEN: Final = 512
"""Bytes of an image that are written in one piece of work."""


class Inner(Protocol):
    """The rest of the ECU; every method but `reset` may raise `Refused`."""

    def read(self, did: Did) -> bytes:
        """All identifiers but CAPACITY, KEY_LIST, STORE and ACTIVE_SESSION."""
        ...

    def write(self, did: Did, value: bytes) -> Long[None]:
        """CALIBRATION and CALIBRATION_STORED."""
        ...

    def self_test(self) -> Long[bytes]:
        """Run the controller of the release that runs on what must lead to a finite plan; the status record."""
        ...

    def reset(self) -> None:
        """Restart, as after power-on, as soon as what was answered has been sent."""


class Programming:
    """`Diagnostics` over a store, after a boot.

    Args:
        refusal: why the ECU may not be programmed now; None if it may.
        report: what identifier STORE reads.
        on_routine: called with each routine that was run, and its status record.
        resets_when_left: whether the end of a session after an announcement resets the ECU.

    Attributes:
        is_updating: whether an image was announced since power-on: the jets stay shut until a reset.
    """

    def __init__(
        self,
        store: Store,
        inner: Inner,
        *,
        refusal: Callable[[], Nrc | None],
        report: Callable[[Store], bytes],
        on_routine: Callable[[Routine, bytes], None] = lambda routine, status: None,
        resets_when_left: bool = False,
    ) -> None:
        self._store = store
        self._inner = inner
        self._refusal = refusal
        self._report = report
        self._on_routine = on_routine
        self._resets_when_left = resets_when_left
        self._announced_length = 0
        self.is_updating = False
        self._has_passed = self._has_confirmed = False
        self._taken_keys = b""

    def enter(self, session: Session) -> None:
        if session is Session.PROGRAMMING:
            self._check_preconditions()

    def leave(self) -> None:
        self._store.drop()
        if self._resets_when_left and self.is_updating:
            self._inner.reset()

    def read(self, did: Did) -> bytes:
        if did is Did.CAPACITY:
            return self._store.capacity.to_bytes(4, "big")
        if did is Did.KEY_LIST:
            return (self._store.keys.version if self._store.keys else 0).to_bytes(4, "big")
        if did is Did.STORE:
            return self._report(self._store)
        return self._inner.read(did)

    def write(self, did: Did, value: bytes) -> Long[None]:
        if did is not Did.KEY_LIST:
            yield from self._inner.write(did, value)
            return
        if value == self._taken_keys:
            return
        # To verify a signature, here and before a way back, takes a good part of a control period.
        self._check_preconditions()
        with _as_refusals():
            self._store.take_keys(value)
        self._taken_keys = value

    def routine(self, routine: Routine, option: bytes) -> Long[bytes]:
        status = yield from self._run(routine, option)
        self._on_routine(routine, status)
        return status

    def _run(self, routine: Routine, option: bytes) -> Long[bytes]:
        with _as_refusals():
            if routine is Routine.PRECONDITIONS:
                self._check_preconditions()
            elif routine is Routine.ERASE:
                return (yield from self._announce(int.from_bytes(option[:4], "big"), option[4:]))
            elif routine is Routine.CHECK:
                return bytes([(yield from self._store.finish())])
            elif routine is Routine.ACTIVATE:
                self._store.activate()
            elif routine is Routine.SELF_TEST:
                return (yield from self._self_test())
            elif routine is Routine.CONFIRM:
                self._confirm()
            elif routine is Routine.REVERT:
                yield from self._revert()
        return b""

    def download(self, offset: int, length: int) -> None:
        if self._store.received is None:
            raise Refused(Nrc.SEQUENCE_ERROR, "no image is announced")
        if offset != self._store.received or offset + length != self._announced_length:
            raise Refused(Nrc.OUT_OF_RANGE, f"bytes {offset}..{offset + length} are not those that are missing")

    def transfer(self, data: bytes) -> Long[None]:
        with _as_refusals():
            self._store.append(data)
        # The store took it at once; a flash memory, which takes milliseconds, is written in so many pieces.
        yield from repeat(None, (len(data) - 1) // WRITTEN)

    def exit(self) -> Long[None]:
        # All bytes came, as the server has seen to; CHECK finds out whether they are the announced ones.
        yield from ()

    def failed_attempts(self, level: Level) -> int:
        return self._store.state.failed_attempts[level]

    def keep_failed_attempts(self, level: Level, count: int) -> None:
        with _as_refusals():
            self._store.records.keep_failed_attempts(level, count)

    def before_reset(self) -> None:
        if not self.is_updating:
            self._check_preconditions()

    def reset(self) -> None:
        self._inner.reset()

    def _check_preconditions(self) -> None:
        if (code := self._refusal()) is not None:
            raise Refused(code)

    def _announce(self, length: int, sha256: bytes) -> Long[bytes]:
        self._check_preconditions()
        self.is_updating, self._has_passed, self._has_confirmed = True, False, False
        offset = yield from self._store.announce(length, sha256)
        self._announced_length = length
        return offset.to_bytes(4, "big")

    def _self_test(self) -> Long[bytes]:
        self._has_passed = False
        status = yield from self._inner.self_test()
        self._has_passed = True
        return status

    def _confirm(self) -> None:
        running = self._store.running
        if running is not None and self._store.state.slots[running].phase == Phase.TRIAL:
            if not self._has_passed:
                raise Refused(Nrc.SEQUENCE_ERROR, "the release on trial did not pass its self-test since this boot")
            self._store.confirm()
            self._has_confirmed = True
        elif not self._has_confirmed:
            # A tester that confirms what does not run on trial takes another release for its own.
            raise Refused(Nrc.SEQUENCE_ERROR, "no release runs on trial")

    def _revert(self) -> Long[None]:
        self._check_preconditions()
        verdict = yield from self._store.revert()
        if verdict != Verdict.GOOD:
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT, f"the release before: {verdict.in_words}")


@contextmanager
def _as_refusals() -> Iterator[None]:
    try:
        yield
    except MediumError as error:
        raise Refused(Nrc.PROGRAMMING_FAILURE, str(error)) from error
    except OutOfOrderError as error:
        raise Refused(Nrc.SEQUENCE_ERROR, str(error)) from error
    except (ConfigError, KeyFileError) as error:
        raise Refused(Nrc.OUT_OF_RANGE, str(error)) from error
