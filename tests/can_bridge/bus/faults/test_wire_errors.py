"""Wrong bits on the wire: as many as the rate says, where it says."""

import pytest

from can_bridge.bus.faults.wire_errors import WireErrors
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_bits
from contract.errors import ConfigError

FRAME = Frame(frame_id=0x555, data=bytes([0x55] * 8), is_fd=False)
BITS = sum(frame_bits(FRAME)) - 3


@pytest.mark.parametrize("rate", [1e-4, 1e-2, 0.5])
def test_frames_are_hit_as_often_as_independent_bits_make_them(rate):
    hook = WireErrors(bit_error_rate=rate).hook(1)
    n = 20_000
    places = [place for _ in range(n) if (place := hook(FRAME, "any", 0)) is not None]
    hit = 1 - (1 - rate) ** BITS
    # Five standard deviations of a binomial number.
    assert abs(len(places) - n * hit) < 5 * (n * hit * (1 - hit)) ** 0.5 + 1e-9
    assert 0 <= min(places) <= max(places) < BITS
    # Place k is first with (1 - rate)^k rate: the mean over a frame that is hit, by summation.
    law = [(1 - rate) ** k * rate / hit for k in range(BITS)]
    mean = sum(k * p for k, p in enumerate(law))
    spread = sum((k - mean) ** 2 * p for k, p in enumerate(law)) ** 0.5
    assert abs(sum(places) / len(places) - mean) < 5 * spread / len(places) ** 0.5


def test_certain_and_impossible_errors():
    assert {WireErrors(bit_error_rate=1.0).hook(1)(FRAME, "any", 0) for _ in range(10)} == {0}
    assert {WireErrors(bit_error_rate=0.0).hook(1)(FRAME, "any", 0) for _ in range(10)} == {None}


def test_only_the_named_nodes_and_frames_are_hit_in_the_span():
    hook = WireErrors(bit_error_rate=1.0, nodes=("ecu",), frame_ids=(0x555,), start_s=1.0, end_s=2.0).hook(1)
    hit = [hook(FRAME, "ecu", at) for at in (999_999_999, 10**9, 2 * 10**9 - 1, 2 * 10**9)]
    assert hit == [None, 0, 0, None]
    assert hook(FRAME, "vehicle", 10**9) is None
    assert hook(Frame(frame_id=0x120, data=b""), "ecu", 10**9) is None


def test_the_seed_decides():
    def run(seed):
        hook = WireErrors(bit_error_rate=0.01).hook(seed)
        return [hook(FRAME, "any", 0) for _ in range(100)]

    assert run(1) == run(1) != run(2)


def test_a_rate_out_of_bounds_is_named():
    with pytest.raises(ConfigError, match=r"wire_errors\.bit_error_rate = 1\.1: must be in \[0, 1\]"):
        WireErrors(bit_error_rate=1.1)
