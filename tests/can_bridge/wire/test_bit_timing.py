"""The bounds against frames built bit by bit, and against published numbers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.bit_timing import worst_case_bits, worst_case_ns
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, Frame


def bits_of(value: int, count: int) -> list[int]:
    return [value >> i & 1 for i in reversed(range(count))]


def stuffed(bits: list[int]) -> list[tuple[int, bool]]:
    """The bits as sent: after five equal ones a complement, which counts towards the next five."""
    sent: list[tuple[int, bool]] = []
    run, last = 0, None
    for bit in bits:
        sent.append((bit, False))
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            last, run = 1 - bit, 1
            sent.append((last, True))
    return sent


def crc15(bits: list[int]) -> int:
    """CRC of classic CAN, polynomial 0x4599 (ISO 11898-1)."""
    crc = 0
    for bit in bits:
        crc = (crc << 1 ^ (0x4599 if (crc >> 14 & 1) ^ bit else 0)) & 0x7FFF
    return crc


def classic_bits(frame: Frame) -> int:
    """Length of this very frame, stuff bits counted, with end of frame and intermission."""
    head = [0, *bits_of(frame.frame_id, 11), 0, 0, 0, *bits_of(len(frame.data), 4)]
    body = head + [bit for byte in frame.data for bit in bits_of(byte, 8)]
    return len(stuffed(body + bits_of(crc15(body), 15))) + 1 + 2 + 7 + 3


def fd_bits(frame: Frame) -> tuple[int, int]:
    """The same for CAN FD with bit-rate switch: bits before and after the switch."""
    arbitration = [0, *bits_of(frame.frame_id, 11), 0, 0, 1, 0, 1]
    rest = [0, *bits_of(FD_LENGTHS.index(len(frame.data)), 4)]
    rest += [bit for byte in frame.data for bit in bits_of(byte, 8)]
    sent = stuffed(arbitration + rest)
    plain = [index for index, (_, is_stuff) in enumerate(sent) if not is_stuff]
    nominal = plain[len(arbitration)]  # what was sent before the first bit after the switch
    # Stuff count and parity (4), CRC, and a fixed stuff bit before the first and after every fourth bit of both.
    field = 4 + (17 if len(frame.data) <= 16 else 21)
    return nominal + 1 + 2 + 7 + 3, len(sent) - nominal + field + 1 + field // 4


PAYLOADS = st.binary(max_size=64) | st.sampled_from([b"\x00", b"\xff", b"\x0f", b"\xf0", b"\x1e", b"\xe1"]).map(
    lambda byte: byte * 64
)


@given(frame_id=st.integers(0, 0x7FF), length=st.sampled_from(CLASSIC_LENGTHS), payload=PAYLOADS)
def test_no_classic_frame_is_longer_than_the_bound(frame_id, length, payload):
    frame = Frame(frame_id=frame_id, data=payload.ljust(length, b"\0")[:length], is_fd=False)
    bound, data_phase = worst_case_bits(frame)
    assert data_phase == 0
    assert classic_bits(frame) <= bound


@given(frame_id=st.integers(0, 0x7FF), length=st.sampled_from(FD_LENGTHS), payload=PAYLOADS)
def test_no_fd_frame_takes_longer_than_the_bound(frame_id, length, payload):
    frame = Frame(frame_id=frame_id, data=payload.ljust(length, b"\0")[:length])
    (nominal, data), (most_nominal, most_data) = fd_bits(frame), worst_case_bits(frame)
    assert nominal <= most_nominal
    assert nominal + data <= most_nominal + most_data


def test_bound_is_not_far_from_a_frame_that_exists():
    """All zeros stuffs once every five bits; the bound allows once every four."""
    classic = Frame(frame_id=0, data=bytes(8), is_fd=False)
    assert worst_case_bits(classic)[0] - classic_bits(classic) <= 8
    fd = Frame(frame_id=0, data=bytes(16))
    assert sum(worst_case_bits(fd)) - sum(fd_bits(fd)) <= 10


@pytest.mark.parametrize(("length", "bits"), [(0, 55), (1, 65), (4, 95), (8, 135)])
def test_classic_bound_is_the_published_one(length, bits):
    """55 + 10 n bits for 11-bit identifiers (Davis et al. 2007)."""
    assert worst_case_bits(Frame(frame_id=1, data=bytes(length), is_fd=False)) == (bits, 0)


@pytest.mark.parametrize(
    ("length", "data_bits"),
    # ESI and DLC, data, stuff bits after the 4 charged to the arbitration phase, CRC field: summed by hand.
    [(0, 5 + 0 + 1 + 27), (16, 5 + 128 + 33 + 27), (20, 5 + 160 + 41 + 32), (64, 5 + 512 + 129 + 32)],
)
def test_fd_bound_by_hand(length, data_bits):
    assert worst_case_bits(Frame(frame_id=1, data=bytes(length))) == (17 + 4 + 13, data_bits)


def test_classic_frame_at_500_kbit():
    frame = Frame(frame_id=1, data=bytes(8), is_fd=False)
    assert worst_case_ns(frame, nominal_bitrate=500_000, data_bitrate=2_000_000) == 270_000


@given(length=st.sampled_from(FD_LENGTHS), nominal=st.integers(1, 10**6), data=st.integers(1, 8 * 10**6))
def test_time_is_the_bits_at_their_rates_rounded_up(length, nominal, data):
    frame = Frame(frame_id=1, data=bytes(length))
    slow, fast = worst_case_bits(frame)
    time_ns = worst_case_ns(frame, nominal_bitrate=nominal, data_bitrate=data)
    scaled = 10**9 * (slow * data + fast * nominal)
    assert (time_ns - 1) * nominal * data < scaled <= time_ns * nominal * data


@given(length=st.sampled_from(FD_LENGTHS[1:]))
def test_longer_data_takes_longer(length):
    shorter = FD_LENGTHS[FD_LENGTHS.index(length) - 1]
    bits = [sum(worst_case_bits(Frame(frame_id=1, data=bytes(n)))) for n in (shorter, length)]
    assert bits[0] < bits[1]


def test_three_messages_fit_a_control_period_many_times_over():
    frames = [Frame(frame_id=1, data=bytes(length)) for length in (16, 8, 16)]
    total = sum(worst_case_ns(frame, nominal_bitrate=500_000, data_bitrate=2_000_000) for frame in frames)
    assert 20 * total < 20_000_000


@pytest.mark.parametrize(("nominal", "data", "culprit"), [(0, 1, "nominal bit rate 0"), (1, -5, "data bit rate -5")])
def test_bad_bit_rate_is_refused(nominal, data, culprit):
    with pytest.raises(ValueError, match=culprit):
        worst_case_ns(Frame(frame_id=1, data=b""), nominal_bitrate=nominal, data_bitrate=data)
