import pytest

from can_bridge.flashing import calibrations
from can_bridge.flashing.backing import MAX_RECORD


def test_what_goes_in_comes_out():
    for kept in ({}, {"ab" * 32: bytes(1024), "cd" * 32: bytes(range(256)) * 4}):
        raw = calibrations.encode(kept)
        assert (calibrations.decode(raw), len(raw) <= MAX_RECORD) == (kept, True)


def test_what_is_no_record_is_refused():
    for raw in (
        b"",
        b"[]",
        b'{"schema": "stillwake-calibrations/1"}',
        b'{"schema": "stillwake-calibrations/2", "kept": {}}',
        b'{"schema": "stillwake-calibrations/1", "kept": []}',
        b'{"schema": "stillwake-calibrations/1", "kept": {}, "more": 1}',
        b'{"schema": "stillwake-calibrations/1", "kept": {"00": 1}}',
        b'{"schema": "stillwake-calibrations/1", "kept": {"00": "zz"}}',
        b" " * 8193,
    ):
        with pytest.raises(ValueError):  # whatever is wrong with it, nothing was kept
            calibrations.decode(raw)
