import itertools

import pytest
from e2e.p02 import e2e_p02_check, e2e_p02_protect
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e import profile2
from can_bridge.wire.message_specs import SPECS

IDS = st.integers(0, 0xFF)
COUNTERS = st.integers(0, 15)
CLASSIC = [spec for spec in SPECS if spec.profile == 2]


@pytest.mark.parametrize(
    ("counter", "crc"),
    list(enumerate((0x0E, 0x1B, 0x98, 0x31, 0x0D, 0x18, 0x9B, 0x65, 0x08, 0x1D, 0x9E, 0x37, 0x0B, 0x1E, 0x9D, 0xCD))),
)
def test_published_answers(counter, crc):
    """AUTOSAR's table for eight zero bytes under the list of data IDs 1 to 16, of which the counter chooses one.

    As the tests of autosar-e2e give it, all 16 entries.
    """
    expected = bytes([crc, counter]) + bytes(6)
    assert profile2.protect(bytes(8), data_id=1 + counter, counter=counter) == expected
    assert profile2.check(expected, data_id=1 + counter)


@given(data=st.binary(min_size=2, max_size=64), data_id=IDS, counter=COUNTERS)
def test_agrees_with_autosar_e2e_in_both_directions(data, data_id, counter):
    """With a list of one data ID 16 times."""
    theirs = bytearray(data)
    theirs[1] = theirs[1] & 0xF0 | counter
    e2e_p02_protect(theirs, bytes([data_id]) * 16, increment_counter=False)
    ours = profile2.protect(data, data_id=data_id, counter=counter)
    assert ours == bytes(theirs)
    assert e2e_p02_check(bytearray(ours), bytes([data_id]) * 16)
    assert profile2.check(bytes(theirs), data_id=data_id)
    assert profile2.counter_of(ours) == counter
    # The upper half of the second byte is the message's.
    assert ours[1] & 0xF0 == data[1] & 0xF0


@given(data=st.binary(min_size=2, max_size=64), data_id=IDS)
def test_verdict_on_any_bytes_is_autosar_e2es(data, data_id):
    assert profile2.check(data, data_id=data_id) == e2e_p02_check(bytearray(data), bytes([data_id]) * 16)


@given(data=st.binary(min_size=2, max_size=64), sent=IDS, expected=IDS)
def test_message_under_anothers_data_id_fails(data, sent, expected):
    protected = profile2.protect(data, data_id=sent, counter=1)
    assert profile2.check(protected, data_id=expected) == (sent == expected)


@pytest.mark.parametrize("spec", CLASSIC, ids=lambda spec: spec.name)
def test_every_error_of_one_to_three_bits_in_eight_bytes_is_found(spec):
    """Exhaustive: 64, 2,016 and 41,664 of them."""
    sound = int.from_bytes(profile2.protect(bytes(range(8)), data_id=spec.data_id, counter=9), "big")
    passed = [
        bits
        for count in (1, 2, 3)
        for bits in itertools.combinations(range(64), count)
        if profile2.check((sound ^ sum(1 << bit for bit in bits)).to_bytes(8, "big"), data_id=spec.data_id)
    ]
    assert passed == []


def test_a_list_of_data_ids_would_let_some_errors_of_two_bits_pass():
    """Why all 16 entries are the same here: with 1 to 16, a flipped counter and data bit can cancel."""
    ids = bytes(range(1, 17))
    found = 0
    for counter in range(16):
        data = bytearray(8)
        data[1] = counter
        e2e_p02_protect(data, ids, increment_counter=False)
        word = int.from_bytes(data, "big")
        for bits in itertools.combinations(range(64), 2):
            found += e2e_p02_check(bytearray((word ^ sum(1 << bit for bit in bits)).to_bytes(8, "big")), ids)
    assert found > 0


@pytest.mark.parametrize("data", [b"", b"\x0e"])
def test_too_short_fails_the_check_without_raising(data):
    assert not profile2.check(data, data_id=1)


@pytest.mark.parametrize(
    ("data", "data_id", "counter", "culprit"),
    [
        (bytes(1), 0, 0, "1 bytes"),
        (bytes(8), 0x100, 0, "0x100"),
        (bytes(8), -1, 0, "data ID"),
        (bytes(8), 0, 16, "counter 16"),
        (bytes(8), 0, -1, "counter -1"),
    ],
)
def test_bad_arguments_are_refused_by_name(data, data_id, counter, culprit):
    with pytest.raises(ValueError, match=culprit):
        profile2.protect(data, data_id=data_id, counter=counter)
