"""The peak of a spectrum against waves whose frequency is known."""

import numpy as np
import pytest

from contract.recording.spectrum import dominant_frequency

PERIOD = 0.25


@pytest.mark.parametrize("cycle", [7.3, 25.0, 60.0])
def test_a_frequency_between_the_lines_of_the_spectrum_is_found(cycle):
    values = 3.0 + np.sin(2 * np.pi * np.arange(500) / cycle + 1.0)
    # An eighth of 1 / duration.
    assert dominant_frequency(values, PERIOD) == pytest.approx(1 / (cycle * PERIOD), abs=1 / (8 * 500 * PERIOD))


def test_no_frequency_without_a_wave():
    assert dominant_frequency(np.ones(100), PERIOD) is None
    assert dominant_frequency(np.arange(5.0), PERIOD) is None
