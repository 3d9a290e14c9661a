"""The bounds against published numbers, and against the exact lengths that `test_frame_bits` checks."""

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.frame import FD_LENGTHS, Frame
from can_bridge.wire.frame_bits import worst_case_bits, worst_case_ns


def test_classic_bound_is_the_published_one():
    """55 + 10 n bits for 11-bit identifiers (Davis et al. 2007)."""
    for length, bits in ((0, 55), (1, 65), (4, 95), (8, 135)):
        assert worst_case_bits(Frame(frame_id=1, data=bytes(length), is_fd=False)) == (bits, 0), length


def test_fd_bound_by_hand():
    """ESI and DLC, data, stuff bits after the 4 charged to the arbitration phase, CRC field."""
    sums = {0: 5 + 0 + 1 + 27, 16: 5 + 128 + 33 + 27, 20: 5 + 160 + 41 + 32, 64: 5 + 512 + 129 + 32}
    for length, data_bits in sums.items():
        assert worst_case_bits(Frame(frame_id=1, data=bytes(length))) == (17 + 4 + 13, data_bits), length


@given(length=st.sampled_from(FD_LENGTHS), nominal=st.integers(1, 10**6), data=st.integers(1, 8 * 10**6))
def test_time_is_the_bits_at_their_rates_rounded_up(length, nominal, data):
    frame = Frame(frame_id=1, data=bytes(length))
    slow, fast = worst_case_bits(frame)
    time_ns = worst_case_ns(frame, nominal_bitrate=nominal, data_bitrate=data)
    scaled = 10**9 * (slow * data + fast * nominal)
    assert (time_ns - 1) * nominal * data < scaled <= time_ns * nominal * data
