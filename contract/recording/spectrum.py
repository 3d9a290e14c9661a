"""At which frequency a series of a recording has most of its power, and how much of it."""

import numpy as np

from contract.arrays import Array


def dominant_frequency(values: Array, period: float) -> float | None:
    """Frequency of the largest peak of a series' spectrum; None for less than 16 samples or a constant.

    Hann window, zero-padded eightfold: the peak is found to an eighth of 1 / duration.
    """
    fluctuation = values - values.mean()
    if len(values) < 16 or not fluctuation.any():
        return None
    padded = 8 * len(values)
    spectrum = np.abs(np.fft.rfft(fluctuation * np.hanning(len(values)), padded))
    # Slower than one and a half periods of the record is drift.
    first = 12
    return float((first + spectrum[first:].argmax()) / (padded * period))


def share_near(values: Array, period: float, frequency: float, width: float) -> float:
    """Share of a series' fluctuations within `width`, relative, of a frequency; Hann window.

    Never narrower than two bins of the spectrum, the width of the window's own peak.
    """
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    bins = np.fft.rfftfreq(len(values), period)
    near = np.abs(bins - frequency) <= max(width * frequency, 2.0 / (len(values) * period))
    return float(power[near].sum() / power.sum())
