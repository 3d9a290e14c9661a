import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.flashing import calibrations
from can_bridge.flashing.backing import MAX_RECORD
from tests.examples import examples

DIGESTS = st.binary(min_size=32, max_size=32).map(bytes.hex)


@examples(50)
@given(st.dictionaries(DIGESTS, st.binary(max_size=1024), max_size=2))
def test_what_goes_in_comes_out(kept):
    raw = calibrations.encode(kept)
    assert calibrations.decode(raw) == kept
    assert len(raw) <= MAX_RECORD


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
