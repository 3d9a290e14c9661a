"""The calibration's identifiers as bytes; `tests/can_bridge/tester` reads, changes and stores over the server."""

import struct

import numpy as np
import pytest

from can_bridge.calibration.segment import Page, Segment
from can_bridge.flashing.backing import MediumError
from can_bridge.uds.calibration_service import CalibrationService
from can_bridge.uds.services import Did, Nrc, Refused
from tests.can_bridge.calibration.conftest import LIMITS
from tests.can_bridge.calibration.conftest import REFERENCE as OWN

WIRE = struct.Struct("<10fI")
"""The layout as a tool reads it that knows nothing of us."""


class Kept:
    """A record that may be worn out."""

    def __init__(self, raw: bytes | None = None) -> None:
        self.raw = raw
        self.is_worn_out = False
        self.writes = 0

    def keep(self, raw: bytes | None) -> None:
        if self.is_worn_out:
            raise MediumError("no place is left that works", 0)
        self.raw, self.writes = raw, self.writes + 1


def service_of(kept: Kept, refusal: Nrc | None = None) -> tuple[CalibrationService, Segment]:
    segment = Segment(OWN, LIMITS)
    return CalibrationService(segment, kept=lambda: kept.raw, keep=kept.keep, refusal=lambda: refusal), segment


def refused(service: CalibrationService, did: Did, value: bytes) -> Nrc:
    with pytest.raises(Refused) as refusal:
        service.write(did, value)
    return refusal.value.code


def values(**changes: float) -> bytes:
    own = {
        **{"drag_mean": 1.0, "drag_fluctuation": 0.1, "lift": 0.01, "lift_mean": 0.0, "smoothness": 8.0},
        **{"effort": 0.0, "rate": 0.0, "prior": 0.0, "action_limit": 0.075, "command_step": 0.0375, "delay_steps": 1},
        **changes,
    }
    *floats, delay_steps = own.values()
    return WIRE.pack(*floats, int(delay_steps))


def test_the_limits_come_with_the_releases_own_values():
    service, _ = service_of(Kept())
    service.write(Did.CALIBRATION, values(lift=0.5))
    raw = service.read(Did.CALIBRATION_LIMITS)
    least, greatest, own = (WIRE.unpack(raw[start : start + WIRE.size]) for start in (0, 44, 88))
    assert len(raw) == 132
    np.testing.assert_array_equal(least, np.zeros(11))
    np.testing.assert_array_equal(greatest, np.array([1000.0] * 8 + [0.075, 0.0375, 6.0], dtype=np.float32))
    assert WIRE.pack(*own) == values()


def test_values_that_are_not_allowed_are_refused_whole():
    service, segment = service_of(Kept())
    nan = values(lift=float("nan"))
    for value in (values(lift=-0.1), nan, values(action_limit=0.0751), values(delay_steps=7), b"", bytes(43)):
        assert refused(service, Did.CALIBRATION, value) is Nrc.OUT_OF_RANGE, value
        assert service.read(Did.CALIBRATION) == values()
        assert segment.take() is None
    for value in (b"", b"\x02", b"\xff", b"\x01\x01"):
        assert refused(service, Did.CALIBRATION_STORED, value) is Nrc.OUT_OF_RANGE, value


def test_what_is_stored():
    """The page in force is; going back where nothing is stored writes nothing; a memory that fails is reported."""
    kept = Kept()
    service, segment = service_of(kept)
    service.write(Did.CALIBRATION, values(lift=0.5))
    segment.page = Page.REFERENCE
    assert service.read(Did.CALIBRATION) == values()
    service.store(segment.in_force)
    assert kept.raw == values()
    service, _ = service_of(empty := Kept(), Nrc.CONDITIONS_NOT_CORRECT)
    service.write(Did.CALIBRATION, values(lift=0.7))
    assert refused(service, Did.CALIBRATION_STORED, b"\x01") is Nrc.CONDITIONS_NOT_CORRECT
    service.write(Did.CALIBRATION_STORED, b"\x00")
    assert (service.read(Did.CALIBRATION), empty.writes) == (values(), 0)
    service, _ = service_of(kept := Kept(values(lift=0.5)))
    service.restore()
    kept.is_worn_out = True
    for value in (b"\x00", b"\x01"):
        assert refused(service, Did.CALIBRATION_STORED, value) is Nrc.PROGRAMMING_FAILURE
    assert service.read(Did.CALIBRATION) == values(lift=0.5)
    # A record that this vehicle does not allow is not used.
    for raw in (b"", bytes(45), values(action_limit=0.08), values(lift=float("inf"))):
        service, segment = service_of(kept := Kept(raw))
        assert "calibration" in str(service.restore())
        assert (segment.take(), kept.raw) == (None, raw)
