"""Profiles 2 and 5 against the published answers, autosar-e2e, the DBC, and every error of a few bits."""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import pytest
from e2e.p02 import e2e_p02_check, e2e_p02_protect
from e2e.p05 import e2e_p05_check, e2e_p05_protect
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e.profiles import PROFILE_2, PROFILE_5, E2eSender, Profile, SenderState, profile_of, protected_frame
from can_bridge.wire.message_specs import PRESSURE, SPECS
from tests.can_bridge.wire.described import decoded
from tests.refused import refused


class Case(NamedTuple):
    """A profile and autosar-e2e's functions for it; profile 2 with a list of one data ID 16 times."""

    ours: Profile
    header: int
    largest_id: int
    largest_counter: int
    protect: Callable[[bytearray, int], object]
    check: Callable[[bytearray, int], bool]


CASES = (
    Case(
        *(PROFILE_2, 2, 0xFF, 15),
        lambda data, data_id: e2e_p02_protect(data, bytes([data_id]) * 16, increment_counter=False),
        lambda data, data_id: e2e_p02_check(data, bytes([data_id]) * 16),
    ),
    Case(
        *(PROFILE_5, 3, 0xFFFF, 255),
        lambda data, data_id: e2e_p05_protect(data, data_id, increment_counter=False),
        e2e_p05_check,
    ),
)
by_profile = pytest.mark.parametrize("case", CASES, ids=["profile 2", "profile 5"])


def test_published_answers():
    """AUTOSAR's examples of eight zero bytes: of profile 5 under data ID 0x1234 (the second as autosar-e2e's tests give
    it), of profile 2 under the list of data IDs 1 to 16, of which the counter chooses one (all as those tests do)."""
    for counter, expected in enumerate(("1cca000000000000", "cf8d010000000000")):
        assert PROFILE_5.protect(bytes(8), data_id=0x1234, counter=counter).hex() == expected, counter
    for counter, crc in enumerate(bytes.fromhex("0e1b98310d189b65081d9e370b1e9dcd")):
        protected = bytes([crc, counter]) + bytes(6)
        assert PROFILE_2.protect(bytes(8), data_id=1 + counter, counter=counter) == protected, counter
        assert PROFILE_2.check(protected, data_id=1 + counter), counter


@by_profile
@given(data=st.data())
def test_agrees_with_autosar_e2e_in_both_directions(case, data):
    content = data.draw(st.binary(min_size=case.header, max_size=64))
    data_id, counter = data.draw(st.integers(0, case.largest_id)), data.draw(st.integers(0, case.largest_counter))
    theirs = bytearray(content)
    theirs[case.header - 1] = theirs[case.header - 1] & ~case.largest_counter & 0xFF | counter
    case.protect(theirs, data_id)
    ours = case.ours.protect(content, data_id=data_id, counter=counter)
    assert ours == bytes(theirs)
    assert case.check(bytearray(ours), data_id)
    assert case.ours.check(bytes(theirs), data_id=data_id)
    assert case.ours.counter_of(ours) == counter
    # On any bytes, and under another message's data ID.
    assert case.ours.check(content, data_id=data_id) == case.check(bytearray(content), data_id)
    other = data.draw(st.integers(0, case.largest_id))
    assert case.ours.check(ours, data_id=other) == (other == data_id)


def undetected(profile: Profile, data_id: int, length: int, most: int) -> list[tuple[int, ...]]:
    sound = int.from_bytes(profile.protect(bytes(range(length)), data_id=data_id, counter=9), "big")
    return [
        bits
        for count in range(1, most + 1)
        for bits in itertools.combinations(range(8 * length), count)
        if profile.check((sound ^ sum(1 << bit for bit in bits)).to_bytes(length, "big"), data_id=data_id)
    ]


def test_every_error_of_a_few_bits_is_found():
    """Exhaustive: 64, 2,016 and 41,664 errors of one to three bits in 8 bytes; 96 and 4,560 of one and two in 12."""
    for spec in SPECS:
        if spec.profile == 2:
            assert undetected(PROFILE_2, spec.data_id, 8, 3) == [], spec.name
    assert undetected(PROFILE_5, SPECS[0].data_id, 12, 2) == []


def test_bad_arguments_are_refused_by_name_and_short_data_fails_its_check():
    for case in CASES:
        short, too_large = case.header - 1, case.largest_id + 1
        for data, data_id, counter, culprit in (
            (bytes(short), 0, 0, f"{short} bytes"),
            (bytes(8), too_large, 0, f"{too_large:#x}"),
            (bytes(8), -1, 0, "data ID"),
            (bytes(8), 0, case.largest_counter + 1, f"counter {case.largest_counter + 1}"),
            (bytes(8), 0, -1, "counter -1"),
        ):
            with refused(ValueError, culprit):
                case.ours.protect(data, data_id=data_id, counter=counter)
        assert not any(case.ours.check(bytes(length), data_id=1) for length in range(case.header))
    with refused(ValueError, "Pressure has 8 bytes: must have 16"):
        E2eSender(PRESSURE).frame(bytes(8), now_ns=0)


def test_crc_and_counter_are_the_signals_of_the_dbc():
    # AUTOSAR: CRC8 with a counter of 4 bits, CRC16 with one of 8.
    assert (PROFILE_2.header_bits, PROFILE_5.header_bits) == (12, 24)
    for spec in SPECS:
        frame = protected_frame(SenderState(counter=11), bytes(spec.protected), spec=spec, now_ns=0)
        signals = decoded(spec.name, frame.data.ljust(spec.length, b"\0"))
        assert profile_of(spec).crc_of(frame.data) == signals["E2E_CRC"] != 0, spec.name
        assert profile_of(spec).counter_of(frame.data) == signals["E2E_Counter"] == 11, spec.name
        assert profile_of(spec).counter_period == (16 if spec.profile == 2 else 256), spec.name
