import struct
from itertools import pairwise
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.calibration.segment import Page, Segment
from contract.controller.calibration import CALIBRATION_NAMES
from contract.errors import ConfigError
from tests.can_bridge.calibration.conftest import LIMITS, REFERENCE, changed
from tests.examples import examples

OFFSETS = {name: 4 * index for index, name in enumerate(CALIBRATION_NAMES)}


def float_bytes(value: float) -> bytes:
    return struct.pack("<f", value)


def test_values_are_taken_together_and_once_from_the_page_in_force(segment):
    assert segment.in_force == REFERENCE
    assert segment.take() is None
    segment.write(OFFSETS["effort"], float_bytes(0.5))
    segment.write(OFFSETS["delay_steps"], (3).to_bytes(4, "little"))
    assert (segment.take(), segment.take()) == (changed(effort=0.5, delay_steps=3), None)
    # As in C, a zero of the other sign counts as another value: a tool can measure it.
    for zero in (0.0, -0.0):
        segment.write(OFFSETS["effort"], float_bytes(zero))
        assert segment.take().pack()[OFFSETS["effort"] :][:4] == float_bytes(zero)
    segment.page = Page.REFERENCE
    assert segment.take() == REFERENCE
    segment.write(OFFSETS["rate"], float_bytes(0.5))
    assert segment.take() is None
    segment.page = Page.WORKING
    assert segment.take() == changed(rate=0.5, delay_steps=3)
    assert segment.read(Page.REFERENCE, 0, 44) == REFERENCE.pack()
    # What is set or reverted is in force at once.
    segment.page = Page.REFERENCE
    segment.set(changed(effort=0.25))
    assert segment.take() == changed(effort=0.25)
    segment.page = Page.REFERENCE
    segment.revert()
    assert (segment.take(), segment.page) == (REFERENCE, Page.WORKING)
    with pytest.raises(ConfigError, match="delay_steps = 7"):
        segment.set(changed(delay_steps=7))
    assert segment.in_force == REFERENCE


def test_half_of_a_value_waits_for_the_rest_or_is_dropped():
    first, second = float_bytes(2.0)[:3], float_bytes(2.0)[3:]
    begin, end = OFFSETS["effort"], OFFSETS["effort"] + 3

    def begun() -> Segment:
        segment = Segment(REFERENCE, LIMITS)
        segment.write(begin, first)
        assert segment.take() is None
        return segment

    segment = begun()
    assert segment.read(Page.WORKING, begin, 4) == first + b"\x00"
    segment.write(end, second)
    assert segment.take() == changed(effort=2.0)
    # Its rest is refused; the page is left; another value is written.
    segment = begun()
    with pytest.raises(ConfigError, match="effort = 2048"):
        segment.write(end, float_bytes(2048.0)[3:])
    assert segment.read(Page.WORKING, 0, 44) == REFERENCE.pack()
    for drop in (Segment.revert, Segment.copy_reference, lambda one: one.write(OFFSETS["rate"], float_bytes(0.0))):
        segment = begun()
        drop(segment)
        assert segment.read(Page.WORKING, 0, 44) == REFERENCE.pack()
        with pytest.raises(ConfigError, match=f"write from byte {end} must begin at a multiple"):
            segment.write(end, second)


@examples(20)
@given(
    weights=st.lists(st.just(0.0) | st.floats(2**-39, 1000, width=32), min_size=8, max_size=8),
    delay=st.integers(0, 6),
    cuts=st.lists(st.integers(1, 43), unique=True).map(sorted),
)
def test_the_whole_set_may_come_in_pieces_and_only_whole_values_are_taken(weights, delay, cuts):
    segment = Segment(REFERENCE, LIMITS)
    raw = struct.pack("<10fI", *weights, 0.05, 0.02, delay)
    old = REFERENCE.pack()
    bounds = [0, *cuts, len(raw)]
    for begin, end in pairwise(bounds):
        segment.write(begin, raw[begin:end])
        assert segment.read(Page.WORKING, 0, end) == raw[:end]
        whole = end - end % 4
        assert segment.in_force.pack() == raw[:whole] + old[whole:]
    assert segment.in_force.pack() == raw


def test_what_is_not_allowed_is_refused_as_a_whole(segment):
    for name in CALIBRATION_NAMES:
        too_great = (7).to_bytes(4, "little") if name == "delay_steps" else float_bytes(1000.001)
        with pytest.raises(ConfigError, match=f"calibration: {name} = .*: must be in 0"):
            segment.write(OFFSETS[name], too_great)
        assert segment.in_force == REFERENCE, name
    for value in (nan, inf, -inf, -1.0, -1e-30):
        with pytest.raises(ConfigError):
            segment.write(OFFSETS["drag_mean"], float_bytes(value))
        with pytest.raises(ConfigError):
            segment.write(OFFSETS["effort"], float_bytes(1.0) + float_bytes(value))
        assert segment.in_force == REFERENCE, value
    for offset, length in ((-1, 1), (44, 1), (41, 4), (0, 45), (0, -1)):
        with pytest.raises(ConfigError, match=r"must be in 0\.\.44"):
            segment.read(Page.WORKING, offset, length)
        if length > 0:
            with pytest.raises(ConfigError, match=r"must be in 0\.\.44"):
                segment.write(offset, bytes(length))
    with pytest.raises(ConfigError, match=r"action_limit = 0\.08"):
        Segment(changed(action_limit=0.08), LIMITS)


def test_a_limit_may_be_reached_though_it_is_no_float32_and_is_not_passed(segment):
    assert float(np.float32(0.075)) > 0.075
    segment.write(OFFSETS["action_limit"], float_bytes(0.05))
    segment.write(OFFSETS["action_limit"], float_bytes(0.075))
    segment.write(OFFSETS["effort"], float_bytes(1.0))
    assert segment.in_force.action_limit == 0.075
    beyond = np.nextafter(np.float32(0.075), np.float32(1))
    with pytest.raises(ConfigError, match="action_limit"):
        segment.write(OFFSETS["action_limit"], beyond.tobytes())
