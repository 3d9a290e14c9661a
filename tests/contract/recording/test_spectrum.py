"""The peak of a spectrum against waves whose frequency is known."""

import numpy as np
import pytest

from contract.recording.plausible import dominant_frequency, share_near

PERIOD = 0.25


def test_a_frequency_between_the_lines_of_the_spectrum_is_found():
    for cycle in (7.3, 25.0, 60.0):
        values = 3.0 + np.sin(2 * np.pi * np.arange(500) / cycle + 1.0)
        # An eighth of 1 / duration.
        assert dominant_frequency(values, PERIOD) == pytest.approx(1 / (cycle * PERIOD), abs=1 / (8 * 500 * PERIOD))
    # No frequency without a wave.
    assert dominant_frequency(np.ones(100), PERIOD) is None
    assert dominant_frequency(np.arange(5.0), PERIOD) is None
    # Two waves share the power by their squares.
    t = 0.2 * np.arange(2000)
    waves = 3.0 * np.sin(2.0 * np.pi * 0.2 * t) + 1.0 * np.cos(2.0 * np.pi * 0.4 * t)
    assert share_near(waves, 0.2, 0.2, 0.1) == pytest.approx(0.9, abs=1e-3)
    assert share_near(waves, 0.2, 0.4, 0.1) == pytest.approx(0.1, abs=1e-3)
