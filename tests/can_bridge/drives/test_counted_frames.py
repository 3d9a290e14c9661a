"""Frames by their counter: what a sender sent is told apart from copies, strays, and another start of it."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.drives.counted_frames import CountedFrame, number


def frame(k: int, time_s: float, modulus: int = 16) -> CountedFrame:
    return CountedFrame(time_s=time_s, counter=k % modulus, data=bytes([k % 251]))


@given(
    kept=st.sets(st.integers(0, 300), min_size=2),
    modulus=st.sampled_from([16, 256]),
    seed=st.integers(0, 1000),
    start=st.floats(0, 1e6),
)
def test_every_frame_keeps_its_place_however_many_are_lost(
    kept: set[int], modulus: int, seed: int, start: float
) -> None:
    """The clock counts the counter's rounds, so gaps of many rounds are told apart."""
    late = np.random.default_rng(seed).uniform(0.0, 0.24, 301)
    places = sorted(kept)
    frames = [frame(k, start + 0.02 * (k + late[k]), modulus) for k in places]
    found = number(frames, period_s=0.02, modulus=modulus)
    (stretch,) = found.stretches
    assert (stretch.index + places[0]).tolist() == places
    assert stretch.frames == tuple(frames)
    assert (found.duplicates, found.misplaced) == (0, 0)


def test_a_clock_that_was_set_by_years_costs_no_memory() -> None:
    frames = [frame(k, 0.02 * k) for k in range(50)] + [frame(k, 1e9 + 0.02 * k) for k in range(50, 100)]
    found = number(frames, period_s=0.02, modulus=16)
    assert [len(one) for one in found.stretches] == [50, 50]
    assert [one.index[-1] for one in found.stretches] == [49, 49]


def test_a_clock_that_shifts_for_good_by_less_than_the_slack_begins_a_stretch() -> None:
    for jump in [0.6, 1.0, 1.9]:
        frames = [frame(k, 0.02 * (k + jump * (k >= 60))) for k in range(120)]
        found = number(frames, period_s=0.02, modulus=16)
        assert [len(one) for one in found.stretches] == [60, 60], jump


def test_single_late_frames_begin_none() -> None:
    frames = [frame(k, 0.02 * (k + 0.9 * (k in (20, 50, 51, 90)))) for k in range(120)]
    found = number(frames, period_s=0.02, modulus=16)
    assert [len(one) for one in found.stretches] == [120]


def test_strays_are_counted_and_harm_nothing() -> None:
    frames = [frame(k, 0.02 * k) for k in range(100)]
    frames[30:30] = [frame(38, 0.5999)]
    frames[70:70] = [frame(77, 1.3601), frame(90, 1.3602)]
    frames.append(frame(108, 1.9801))
    found = number(frames, period_s=0.02, modulus=16)
    (stretch,) = found.stretches
    assert stretch.index.tolist() == list(range(100))
    assert (found.duplicates, found.misplaced) == (0, 4)
