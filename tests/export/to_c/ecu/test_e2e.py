"""The protection in C against another implementation and AUTOSAR's published answer."""

import itertools

import pytest
from e2e.p02 import e2e_p02_check, e2e_p02_protect
from e2e.p05 import e2e_p05_check, e2e_p05_protect
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e.profiles import profile_of

LENGTHS = {5: 3, 2: 2}
"""Of the headers."""


def autosar_protect(profile: int, data: bytes, data_id: int, counter: int) -> bytes:
    theirs = bytearray(data)
    if profile == 5:
        theirs[2] = counter
        e2e_p05_protect(theirs, data_id, increment_counter=False)
    else:
        theirs[1] = theirs[1] & 0xF0 | counter
        e2e_p02_protect(theirs, bytes([data_id]) * 16, increment_counter=False)
    return bytes(theirs)


def autosar_check(profile: int, data: bytes, data_id: int) -> bool:
    if profile == 5:
        return bool(e2e_p05_check(bytearray(data), data_id))
    return bool(e2e_p02_check(bytearray(data), bytes([data_id]) * 16))


def protected(parts, data: bytes, data_id: int, counter: int) -> bytes:
    buffer = parts.ffi.new("uint8_t[]", data)
    parts.lib.sw_e2e_protect(buffer, len(data), data_id, counter)
    return bytes(parts.ffi.buffer(buffer, len(data)))


def checked(parts, data: bytes, data_id: int) -> bool:
    return bool(parts.lib.sw_e2e_check(parts.ffi.from_buffer("uint8_t[]", data), len(data), data_id))


def test_the_published_answers(parts):
    """Profile 5: AUTOSAR's example. Profile 2: AUTOSAR's table for counter 0, data ID 1, eight zero bytes."""
    if parts.messages.pressure.spec.profile == 5:
        assert protected(parts, bytes(8), 0x1234, 0) == bytes.fromhex("1cca000000000000")
    else:
        assert protected(parts, bytes(8), 1, 0) == bytes([0x0E]) + bytes(7)


@given(data=st.binary(min_size=3, max_size=64), data_id=st.integers(0, 0xFFFF), counter=st.integers(0, 255))
def test_agrees_with_autosar_e2e_in_both_directions(parts, data, data_id, counter):
    profile = parts.messages.pressure.spec.profile
    if profile == 2:
        data_id, counter = data_id & 0xFF, counter & 0xF
    ours = protected(parts, data, data_id, counter)
    assert ours == autosar_protect(profile, data, data_id, counter)
    assert checked(parts, ours, data_id)
    assert checked(parts, data, data_id) == autosar_check(profile, data, data_id)
    assert parts.lib.sw_e2e_counter(parts.ffi.from_buffer("uint8_t[]", ours)) == counter


def test_what_is_shorter_than_its_header_fails(parts):
    profile = parts.messages.pressure.spec.profile
    for length, data_id in itertools.product(range(LENGTHS[profile]), range(256)):
        assert not checked(parts, bytes(length), data_id)
        assert not checked(parts, b"\xff" * length, data_id)


def test_every_flipped_bit_of_every_message_is_found(parts):
    for spec in parts.messages.specs:
        sound = protected(parts, bytes(range(spec.length)), spec.data_id, 7)
        assert checked(parts, sound, spec.data_id)
        for bit in range(8 * spec.length):
            wrong = bytearray(sound)
            wrong[bit // 8] ^= 1 << bit % 8
            assert not checked(parts, bytes(wrong), spec.data_id)


@pytest.mark.parametrize("which", range(3))
def test_a_message_under_anothers_data_id_fails(parts, which):
    specs = parts.messages.specs
    sound = protected(parts, bytes(specs[which].length), specs[which].data_id, 3)
    assert [checked(parts, sound, spec.data_id) for spec in specs] == [index == which for index in range(3)]
    assert profile_of(specs[which]).check(sound, data_id=specs[which].data_id)
