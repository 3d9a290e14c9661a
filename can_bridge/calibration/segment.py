"""The calibration as a memory segment. UDS and XCP read and write it; the controller reads it between periods.

The working page is writable; the reference page has the release's own values. A value takes effect with the next
control period after all its bytes have been written, if it is within its limits.
"""

from enum import IntEnum
from typing import Final

from contract.controller.calibration import PACKED_BYTES, Calibration, CalibrationLimits
from contract.errors import ConfigError

ADDRESS: Final = 0x2000_0000
"""The address at which a tool finds the segment: the beginning of a Cortex-M's RAM."""
VALUE_BYTES: Final = 4


class Page(IntEnum):
    WORKING = 0
    REFERENCE = 1


class Segment:
    """The two pages; `page` is the page in force. Raises ConfigError if the release's values are outside the limits."""

    def __init__(self, reference: Calibration, limits: CalibrationLimits) -> None:
        limits.check(reference)
        self.reference = self._working = self._taken = reference
        self.limits = limits
        self.page = Page.WORKING
        self._begun_at, self._begun = 0, b""

    @property
    def in_force(self) -> Calibration:
        """The values of the page in force; the controller uses them from the next control period on."""
        return self._working if self.page is Page.WORKING else self.reference

    def read(self, page: Page, offset: int, length: int) -> bytes:
        """Return bytes of a page, also of a partly written value; raises ConfigError beyond the end of the segment."""
        _check_range(offset, length)
        raw = bytearray((self._working if page is Page.WORKING else self.reference).pack())
        if page is Page.WORKING:
            raw[self._begun_at : self._begun_at + len(self._begun)] = self._begun
        return bytes(raw[offset : offset + length])

    def write(self, offset: int, data: bytes) -> None:
        """Write bytes of the working page, from the first byte of a value or from where the last write ended. The bytes
        of a partly written value are kept until the rest is written; a write to another place discards them. Raises
        ConfigError for a range outside the segment, a write that begins inside a value, or a forbidden value."""
        _check_range(offset, len(data))
        if self._begun and offset == self._begun_at + len(self._begun):
            offset, data = self._begun_at, self._begun + data
        if offset % VALUE_BYTES:
            raise ConfigError(
                f"calibration: a write from byte {offset} must begin at a multiple of {VALUE_BYTES}, where values "
                "begin, or where the last write ended"
            )
        whole = len(data) - len(data) % VALUE_BYTES
        self._begun = b""
        if whole:
            raw = bytearray(self._working.pack())
            raw[offset : offset + whole] = data[:whole]
            calibration = Calibration.unpack(bytes(raw))
            self.limits.check(calibration)
            self._working = calibration
        self._begun_at, self._begun = offset + whole, data[whole:]

    def set(self, calibration: Calibration) -> None:
        """Write the working page and put it in force. Raises ConfigError for a value that is not allowed."""
        self.limits.check(calibration)
        self._working = calibration
        self._begun = b""
        self.page = Page.WORKING

    def revert(self) -> None:
        """Copy the release's own values to the working page, and put the working page in force."""
        self.copy_reference()
        self.page = Page.WORKING

    def copy_reference(self) -> None:
        self._working = self.reference
        self._begun = b""

    def take(self) -> Calibration | None:
        """Return the values in force if a page was written or selected since the last call, otherwise None. Another
        thread than the writer's may call this method, because a set of values is replaced as a whole."""
        values = self.in_force
        # Objects are compared, because equal values can differ in the sign of a zero, which a tool can measure.
        if values is self._taken:
            return None
        self._taken = values
        return values


def _check_range(offset: int, length: int) -> None:
    if offset < 0 or length < 0 or offset + length > PACKED_BYTES:
        raise ConfigError(f"calibration: {length} bytes from byte {offset} must be in 0..{PACKED_BYTES}")
