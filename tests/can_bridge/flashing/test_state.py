import struct
import zlib
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.flashing import state
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import MAX_RECORD, Slot
from can_bridge.flashing.state import Phase, SlotState, StoreState
from contract.printable import is_name
from tests.examples import examples

U32 = st.integers(0, 2**32 - 1)
NAMES = st.text(min_size=1, max_size=100).filter(is_name)
HASHES = st.binary(min_size=32, max_size=32)


@st.composite
def slots(draw, phases=tuple(Phase)):
    phase = draw(st.sampled_from(phases))
    if phase == Phase.EMPTY:
        return SlotState()
    length = draw(st.integers(1, 2**32 - 1))
    common = SlotState(phase=phase, length=length, sha256=draw(HASHES), received=draw(st.integers(0, length)))
    if phase == Phase.FILLING or (phase == Phase.BAD and draw(st.booleans())):
        return common
    return replace(
        common,
        received=length,
        digest=draw(HASHES).hex(),
        name=draw(NAMES),
        security_version=draw(U32),
        signer=draw(HASHES),
        boots_left=draw(st.integers(0, 3)) if phase == Phase.TRIAL else 0,
    )


@st.composite
def states(draw):
    first = draw(slots())
    others = [phase for phase in Phase if phase != first.phase or phase not in (Phase.CHECKED, Phase.TRIAL)]
    second = draw(slots(tuple(others)))
    confirmed = [
        slot for slot, standing in zip(Slot, (first, second), strict=True) if standing.phase == Phase.CONFIRMED
    ]
    return StoreState(
        slots=(first, second),
        active=draw(st.sampled_from([None, *confirmed])),
        least_security_version=draw(st.integers(1, 2**32 - 1)),
        failed_attempts={level: draw(st.integers(0, 255)) for level in Level},
    )


FULL = SlotState(
    phase=Phase.CONFIRMED, length=97_000, sha256=bytes(range(32)), received=97_000, digest="ab" * 32, name="truck",
    security_version=7, signer=b"s" * 32,
)  # fmt: skip
SAMPLE = StoreState(slots=(FULL, SlotState(phase=Phase.FILLING, length=5, sha256=b"h" * 32, received=3)), active=Slot.A)


def sealed(body: bytes) -> bytes:
    return body + struct.pack(">I", zlib.crc32(body))


@examples(200)
@given(states())
def test_what_goes_in_comes_out(value):
    raw = state.encode(value)
    assert state.decode(raw) == value
    assert len(raw) < MAX_RECORD


def test_the_layout_is_as_described():
    first = bytes([4, 0]) + struct.pack(">III", 97_000, 97_000, 7) + bytes(range(32)) + b"\xab" * 32 + b"s" * 32
    second = bytes([1, 0]) + struct.pack(">III", 5, 3, 0) + b"h" * 32 + bytes(64)
    body = b"SWS1" + first + b"\0\x05truck" + second + b"\0\0" + b"\0" + struct.pack(">I", 1) + b"\0\0"
    assert state.encode(SAMPLE) == sealed(body)


def test_no_truncated_and_no_longer_record_is_read():
    raw, body = state.encode(SAMPLE), state.encode(SAMPLE)[:-4]
    sums_fit = [sealed(cut) for cut in (*(body[:length] for length in range(len(body))), body + b"\0")]
    for cut in (*(raw[:length] for length in range(len(raw))), raw + b"\0", *sums_fit):
        with pytest.raises(ValueError, match="state"):
            state.decode(cut)


def test_no_flipped_bit_goes_unseen():
    raw = state.encode(SAMPLE)
    for bit in range(8 * len(raw)):
        damaged = bytearray(raw)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(ValueError, match="damaged"):
            state.decode(bytes(damaged))


def test_a_state_that_no_store_keeps_is_not_read():
    for wrong in (
        replace(SAMPLE, active=Slot.B),
        replace(SAMPLE, least_security_version=0),
        SAMPLE.with_slot(Slot.B, replace(SAMPLE.slots[1], received=6)),
        SAMPLE.with_slot(Slot.B, replace(SAMPLE.slots[1], boots_left=4)),
        SAMPLE.with_slot(Slot.A, replace(FULL, received=96_999)),
        SAMPLE.with_slot(Slot.A, replace(FULL, name="")),
        SAMPLE.with_slot(Slot.A, replace(FULL, name="a\nb")),
        replace(SAMPLE, slots=(replace(FULL, phase=Phase.TRIAL),) * 2, active=None),
        replace(SAMPLE, slots=(replace(FULL, phase=Phase.CHECKED),) * 2, active=None),
    ):
        with pytest.raises(ValueError, match="state"):
            state.decode(state.encode(wrong))


@examples(200)
@given(st.binary(max_size=400))
def test_any_bytes_are_refused_or_are_a_state(body):
    try:
        found = state.decode(sealed(b"SWS1" + body))
    except ValueError:
        return
    assert state.decode(state.encode(found)) == found
