"""Wrong bits on the wire: as many as the rate says, where it says."""

from can_bridge.bus.faults.wire_errors import WireErrors
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_bits

FRAME = Frame(frame_id=0x555, data=bytes([0x55] * 8), is_fd=False)
BITS = sum(frame_bits(FRAME)) - 3


def test_frames_are_hit_as_often_as_independent_bits_make_them():
    for rate in [1e-4, 1e-2, 0.5]:
        hook = WireErrors(bit_error_rate=rate).hook(1)
        n = 4_000
        places = [place for _ in range(n) if (place := hook(FRAME, "any", 0)) is not None]
        hit = 1 - (1 - rate) ** BITS
        # Five standard deviations of a binomial number.
        assert abs(len(places) - n * hit) < 5 * (n * hit * (1 - hit)) ** 0.5 + 1e-9, rate
        assert 0 <= min(places) <= max(places) < BITS, rate
        # Place k is first with (1 - rate)^k rate: the mean over a frame that is hit, by summation.
        law = [(1 - rate) ** k * rate / hit for k in range(BITS)]
        mean = sum(k * p for k, p in enumerate(law))
        spread = sum((k - mean) ** 2 * p for k, p in enumerate(law)) ** 0.5
        assert abs(sum(places) / len(places) - mean) < 5 * spread / len(places) ** 0.5, rate


def test_only_the_named_nodes_and_frames_are_hit_in_the_span():
    hook = WireErrors(bit_error_rate=1.0, nodes=("ecu",), frame_ids=(0x555,), start_s=1.0, end_s=2.0).hook(1)
    hit = [hook(FRAME, "ecu", at) for at in (999_999_999, 10**9, 2 * 10**9 - 1, 2 * 10**9)]
    assert hit == [None, 0, 0, None]
    assert hook(FRAME, "vehicle", 10**9) is None
    assert hook(Frame(frame_id=0x120, data=b""), "ecu", 10**9) is None
