import itertools

import pytest
from e2e.p05 import e2e_p05_check, e2e_p05_protect
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e import profile5
from can_bridge.wire.message_specs import SPECS

IDS = st.integers(0, 0xFFFF)
COUNTERS = st.integers(0, 255)


@pytest.mark.parametrize(("counter", "expected"), [(0, "1cca000000000000"), (1, "cf8d010000000000")])
def test_published_answers(counter, expected):
    """AUTOSAR's example: eight zero bytes under data ID 0x1234. The second is as autosar-e2e's tests give it."""
    assert profile5.protect(bytes(8), data_id=0x1234, counter=counter) == bytes.fromhex(expected)


@given(data=st.binary(min_size=3, max_size=64), data_id=IDS, counter=COUNTERS)
def test_agrees_with_autosar_e2e_in_both_directions(data, data_id, counter):
    theirs = bytearray(data)
    theirs[2] = counter
    e2e_p05_protect(theirs, data_id, increment_counter=False)
    ours = profile5.protect(data, data_id=data_id, counter=counter)
    assert ours == bytes(theirs)
    # autosar-e2e takes a mutable buffer only.
    assert e2e_p05_check(bytearray(ours), data_id)
    assert profile5.check(bytes(theirs), data_id=data_id)
    assert profile5.counter_of(ours) == counter


@given(data=st.binary(min_size=3, max_size=64), data_id=IDS)
def test_verdict_on_any_bytes_is_autosar_e2es(data, data_id):
    assert profile5.check(data, data_id=data_id) == e2e_p05_check(bytearray(data), data_id)


@given(data=st.binary(min_size=3, max_size=64), sent=IDS, expected=IDS)
def test_message_under_anothers_data_id_fails(data, sent, expected):
    protected = profile5.protect(data, data_id=sent, counter=1)
    assert profile5.check(protected, data_id=expected) == (sent == expected)


def test_every_one_and_two_bit_error_in_twelve_bytes_is_found():
    """Exhaustive: 96 single and 4,560 double errors."""
    sound = profile5.protect(bytes(range(12)), data_id=SPECS[0].data_id, counter=200)
    word = int.from_bytes(sound, "big")
    passed = [
        bits
        for count in (1, 2)
        for bits in itertools.combinations(range(96), count)
        if profile5.check((word ^ sum(1 << bit for bit in bits)).to_bytes(12, "big"), data_id=SPECS[0].data_id)
    ]
    assert passed == []


@pytest.mark.parametrize("data", [b"", b"\x1c", b"\x1c\xca"])
def test_too_short_fails_the_check_without_raising(data):
    assert not profile5.check(data, data_id=0x1234)


@pytest.mark.parametrize(
    ("data", "data_id", "counter", "culprit"),
    [
        (bytes(2), 0, 0, "2 bytes"),
        (bytes(8), 0x10000, 0, "0x10000"),
        (bytes(8), -1, 0, "data ID"),
        (bytes(8), 0, 256, "counter 256"),
        (bytes(8), 0, -1, "counter -1"),
    ],
)
def test_bad_arguments_are_refused_by_name(data, data_id, counter, culprit):
    with pytest.raises(ValueError, match=culprit):
        profile5.protect(data, data_id=data_id, counter=counter)
