"""What the calibration's identifiers refuse and store; `tests/stillwake/test_testers.py` reads and changes them."""

import pytest

from can_bridge.calibration.segment import Page, Segment
from can_bridge.flashing.backing import MediumError
from can_bridge.uds.calibration_service import CalibrationService
from can_bridge.uds.services import Did, Nrc, Refused
from tests.can_bridge.calibration.conftest import LIMITS, REFERENCE, changed

OWN, OTHER = REFERENCE.pack(), changed(lift=0.5).pack()
NEGATIVE, NAN = (OWN[:8] + lift + OWN[12:] for lift in (b"\0\0\x80\xbf", b"\0\0\xc0\x7f"))


class Kept:
    """A service whose record may be worn out."""

    def __init__(self, raw: bytes | None = None, refusal: Nrc | None = None) -> None:
        self.raw, self.is_worn_out, self.writes = raw, False, 0
        self.segment = Segment(REFERENCE, LIMITS)
        self.service = CalibrationService(self.segment, kept=lambda: self.raw, keep=self._keep, refusal=lambda: refusal)

    def _keep(self, raw: bytes | None) -> None:
        if self.is_worn_out:
            raise MediumError("no place is left that works", 0)
        self.raw, self.writes = raw, self.writes + 1


def refused(kept: Kept, did: Did, value: bytes) -> Nrc:
    with pytest.raises(Refused) as refusal:
        kept.service.write(did, value)
    return refusal.value.code


def test_values_that_are_not_allowed_are_refused_whole():
    kept = Kept()
    for value in (NEGATIVE, NAN, changed(delay_steps=7).pack(), b"", bytes(43)):
        assert refused(kept, Did.CALIBRATION, value) is Nrc.OUT_OF_RANGE, value
        assert (kept.service.read(Did.CALIBRATION), kept.segment.take()) == (OWN, None)
    for value in (b"", b"\x02", b"\xff", b"\x01\x01"):
        assert refused(kept, Did.CALIBRATION_STORED, value) is Nrc.OUT_OF_RANGE, value


def test_what_is_stored():
    """The page in force is; going back where nothing is stored writes nothing; a memory that fails is reported."""
    kept = Kept()
    kept.service.write(Did.CALIBRATION, OTHER)
    kept.segment.page = Page.REFERENCE
    assert kept.service.read(Did.CALIBRATION) == OWN
    kept.service.store(kept.segment.in_force)
    assert kept.raw == OWN
    kept = Kept(refusal=Nrc.CONDITIONS_NOT_CORRECT)
    kept.service.write(Did.CALIBRATION, OTHER)
    assert refused(kept, Did.CALIBRATION_STORED, b"\x01") is Nrc.CONDITIONS_NOT_CORRECT
    kept.service.write(Did.CALIBRATION_STORED, b"\x00")
    assert (kept.service.read(Did.CALIBRATION), kept.writes) == (OWN, 0)
    kept = Kept(OTHER)
    kept.service.restore()
    kept.is_worn_out = True
    for value in (b"\x00", b"\x01"):
        assert refused(kept, Did.CALIBRATION_STORED, value) is Nrc.PROGRAMMING_FAILURE
    assert kept.service.read(Did.CALIBRATION) == OTHER
    # A record that this vehicle does not allow is not used.
    for raw in (b"", bytes(45), changed(action_limit=0.08).pack(), NAN):
        kept = Kept(raw)
        assert "calibration" in str(kept.service.restore())
        assert (kept.segment.take(), kept.raw) == (None, raw)
