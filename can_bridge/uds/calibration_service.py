"""The calibration of an ECU through UDS: identifiers to read and write, and values in non-volatile memory.

Stored values are used only with the release for which they were stored, and only if the vehicle's settings allow them.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from can_bridge.calibration.segment import Page, Segment
from can_bridge.flashing.backing import MediumError
from can_bridge.flashing.store import OutOfOrderError
from can_bridge.uds.services import Did, Nrc, Refused
from contract.controller.calibration import PACKED_BYTES, Calibration
from contract.errors import ConfigError, KeyFileError

REVERT, STORE = b"\x00", b"\x01"
"""Values of `Did.CALIBRATION_STORED`."""


class CalibrationService:
    """A service for the identifiers of the calibration; the server checks session, security level and length.

    Args:
        kept: returns the values stored for the running release, or None.
        keep: stores values; None deletes the stored values. May raise MediumError, or OutOfOrderError while the slot is
            being written.
        refusal: returns the reason why nothing may be stored now, or None. Storing is refused while jets are enabled,
            because it could take longer than a control period. The values in force may always be changed.
    """

    def __init__(
        self,
        segment: Segment,
        *,
        kept: Callable[[], bytes | None],
        keep: Callable[[bytes | None], None],
        refusal: Callable[[], Nrc | None],
    ) -> None:
        self._segment = segment
        self._kept, self._keep, self._refusal = kept, keep, refusal

    def restore(self) -> ConfigError | None:
        """Put stored values in force after power-on; return the error if they are not allowed."""
        try:
            if (raw := self._kept()) is not None:
                self._segment.set(Calibration.unpack(raw))
        except ConfigError as error:
            return error
        return None

    def store(self, calibration: Calibration | None) -> None:
        """Store values that are or were in force, or delete the stored values; raises Refused if not possible now."""
        if (code := self._refusal()) is not None:
            raise Refused(code)
        with as_refusals():
            self._keep(None if calibration is None else calibration.pack())

    def read(self, did: Did) -> bytes:
        """Return the value of an identifier; raises Refused for an identifier that is not of the calibration."""
        segment = self._segment
        if did is Did.CALIBRATION:
            return segment.in_force.pack()
        if did is Did.CALIBRATION_LIMITS:
            release = segment.read(Page.REFERENCE, 0, PACKED_BYTES)
            return segment.limits.least.pack() + segment.limits.greatest.pack() + release
        if did is Did.CALIBRATION_STORED:
            return REVERT if self._kept() is None else STORE
        raise Refused(Nrc.OUT_OF_RANGE)

    def write(self, did: Did, value: bytes) -> None:
        """Write an identifier; raises Refused if the identifier cannot be written or the value is not allowed."""
        if did is Did.CALIBRATION:
            with as_refusals():
                self._segment.set(Calibration.unpack(value))
        elif did is Did.CALIBRATION_STORED and value == STORE:
            self.store(self._segment.in_force)
        elif did is Did.CALIBRATION_STORED and value == REVERT:
            if self._kept() is not None:
                self.store(None)
            self._segment.revert()
        else:
            raise Refused(Nrc.OUT_OF_RANGE)


@contextmanager
def as_refusals() -> Iterator[None]:
    """Raise Refused, with a UDS code, in place of an error of the store."""
    try:
        yield
    except MediumError as error:
        raise Refused(Nrc.PROGRAMMING_FAILURE, str(error)) from error
    except OutOfOrderError as error:
        raise Refused(Nrc.SEQUENCE_ERROR, str(error)) from error
    except (ConfigError, KeyFileError) as error:
        raise Refused(Nrc.OUT_OF_RANGE, str(error)) from error
