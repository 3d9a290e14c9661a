import pytest

from can_bridge.flashing import remembered
from can_bridge.flashing.backing import MAX_RECORD


def test_what_goes_in_comes_out():
    for kept in ({}, {"ab" * 32: bytes(1024), "cd" * 32: bytes(range(256)) * 4}):
        raw = remembered.encode_calibrations(kept)
        assert (remembered.decode_calibrations(raw), len(raw) <= MAX_RECORD) == (kept, True)


def test_what_is_no_record_is_refused():
    raw = remembered.encode_calibrations({"ab" * 32: b"one", "cd" * 32: b"two"})
    assert raw == b"SWC1\2" + b"\xab" * 32 + b"\0\3one" + b"\xcd" * 32 + b"\0\3two"
    cut = (raw[:length] for length in range(len(raw)))
    too_long = b"SWC1\1" + raw[5:37] + b"\4\1" + bytes(1025)
    for wrong in (*cut, raw + b"\0", b"SWC2" + raw[4:], b"SWC1\3" + raw[5:], too_long):
        with pytest.raises(ValueError):  # whatever is wrong with it, nothing was kept
            remembered.decode_calibrations(wrong)
