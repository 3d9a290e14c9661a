import struct
import zlib
from dataclasses import replace

from can_bridge.flashing import state
from can_bridge.flashing.backing import MAX_RECORD, Slot
from can_bridge.flashing.state import Level, SlotPhase, SlotState, StoreState
from contract.printable import MAX_NAME
from tests.refused import refused

FULL = SlotState(
    phase=SlotPhase.CONFIRMED, length=97_000, sha256=bytes(range(32)), received=97_000, digest="ab" * 32, name="truck",
    security_version=7, signer=b"s" * 32,
)  # fmt: skip
SAMPLE = StoreState(
    slots=(FULL, SlotState(phase=SlotPhase.FILLING, length=5, sha256=b"h" * 32, received=3)), active=Slot.A
)


def sealed(body: bytes) -> bytes:
    return body + struct.pack(">I", zlib.crc32(body))


def test_what_goes_in_comes_out():
    bad = SlotState(phase=SlotPhase.BAD, length=9, sha256=b"h" * 32, received=9)
    named = replace(bad, digest="cd" * 32, name="\U0001f69a" * MAX_NAME, security_version=2**32 - 1, signer=b"k" * 32)
    trial = replace(named, phase=SlotPhase.TRIAL, boots_left=3)
    checked = replace(named, phase=SlotPhase.CHECKED)
    for value in (
        StoreState(),
        SAMPLE,
        *(replace(SAMPLE, slots=(FULL, other)) for other in (bad, named, trial, checked)),
        replace(SAMPLE, slots=(trial, FULL), active=Slot.B, least_security_version=2**32 - 1),
        replace(SAMPLE, failed_attempts={level: 255 - level for level in Level}),
    ):
        raw = state.encode(value)
        assert (state.decode(raw), len(raw) < MAX_RECORD) == (value, True)
    # The layout is as described.
    first = bytes([4, 0]) + struct.pack(">III", 97_000, 97_000, 7) + bytes(range(32)) + b"\xab" * 32 + b"s" * 32
    second = bytes([1, 0]) + struct.pack(">III", 5, 3, 0) + b"h" * 32 + bytes(64)
    body = b"SWS1" + first + b"\0\x05truck" + second + b"\0\0" + b"\0" + struct.pack(">I", 1) + b"\0\0"
    assert state.encode(SAMPLE) == sealed(body)


def test_what_is_damaged_and_what_no_store_keeps_is_not_read():
    raw, body = state.encode(SAMPLE), state.encode(SAMPLE)[:-4]
    flipped = int.from_bytes(raw, "big")
    filling = SAMPLE.slots[1]
    seconds = (
        replace(filling, received=6),
        replace(filling, boots_left=1),
        replace(filling, security_version=1),
        replace(FULL, phase=SlotPhase.FILLING),
        replace(FULL, phase=SlotPhase.TRIAL, boots_left=4),
        replace(filling, phase=SlotPhase.BAD),
        replace(filling, phase=SlotPhase.EMPTY),
        replace(filling, digest="ab" * 32),
    )
    never_kept = (
        replace(SAMPLE, active=Slot.B),
        replace(SAMPLE, least_security_version=0),
        *(SAMPLE.with_slot(Slot.B, second) for second in seconds),
        *(SAMPLE.with_slot(Slot.A, replace(FULL, name=name)) for name in ("", "a\nb")),
        SAMPLE.with_slot(Slot.A, replace(FULL, received=96_999)),
        replace(SAMPLE, slots=(replace(FULL, phase=SlotPhase.TRIAL),) * 2, active=None),
        replace(SAMPLE, slots=(replace(FULL, phase=SlotPhase.CHECKED),) * 2, active=None),
    )
    for damaged in (
        *(raw[:length] for length in range(len(raw))),
        raw + b"\0",
        *((flipped ^ 1 << bit).to_bytes(len(raw), "big") for bit in range(8 * len(raw))),
        # With a sum that fits.
        *map(sealed, (*(body[:length] for length in range(len(body))), body + b"\0")),
        *map(state.encode, never_kept),
    ):
        with refused(ValueError, "state"):
            state.decode(damaged)
