"""Open-loop forcing signals, sampled at the control period (paper, section 2.1), and exploration noise."""

from collections.abc import Callable
from typing import Final, Literal

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from contract.arrays import Array
from contract.config.plant import FlowConfig, ForcingConfig
from contract.errors import ConfigError

ForcingName = Literal["training", "chirp", "extended_chirp", "none"]


def training(steps: int, forcing: ForcingConfig, flow: FlowConfig, rng: np.random.Generator) -> Array:
    """Compute the training waveform, (steps,), in U_inf W. The carrier's frequency is near the shedding frequency and
    varies with noise, low-pass filtered and normalised by its largest magnitude; its amplitude follows a slow sinusoid.
    The envelope reaches 1 + depth, so that the strongest part of the signal is clipped and explores the full
    amplitude."""
    dt = flow.control_period
    # The filter starts from zero, so the first few cut-off periods of its output are discarded.
    settle = int(4.0 / (forcing.modulation_cutoff * dt))
    lowpass = butter(2, forcing.modulation_cutoff, fs=1.0 / dt, output="sos")
    eta = sosfilt(lowpass, rng.standard_normal(settle + steps))[settle:]
    eta /= np.abs(eta).max()
    frequency = forcing.base_frequency + forcing.modulation_index * eta
    phase = 2.0 * np.pi * (rng.random() + np.cumsum(frequency) * dt)
    t = np.arange(steps) * dt
    envelope = 1.0 + forcing.envelope_depth * np.sin(2.0 * np.pi * (forcing.envelope_frequency * t + rng.random()))
    signal: Array = flow.action_limit * np.clip(envelope * np.sin(phase), -1.0, 1.0)
    return signal


def sine(steps: int, flow: FlowConfig, *, amplitude: float, frequency: float) -> Array:
    """Compute a sine that starts at zero and rises, (steps,), in U_inf W; the frequency is in 1/t_c. Raises ConfigError
    for an amplitude above the bound, or a frequency that is not positive or above the control steps' Nyquist frequency.
    """
    if not 0.0 <= amplitude <= flow.action_limit:
        raise ConfigError(f"amplitude = {amplitude}: must be between 0 and {flow.action_limit}")
    highest = 0.5 / flow.control_period
    if not 0.0 < frequency < highest:
        raise ConfigError(f"frequency = {frequency}: must be positive and below {highest}, half the control rate")
    signal: Array = amplitude * np.sin(2.0 * np.pi * frequency * flow.control_period * np.arange(steps))
    return signal


def exploration(steps: int, forcing: ForcingConfig, flow: FlowConfig, rng: np.random.Generator, *, rms: float) -> Array:
    """Compute coloured noise to add to a controller's commands; shape (steps,), in U_inf W. The noise is an
    Ornstein-Uhlenbeck process: Gaussian, stationary from the first step on, with autocorrelation exp(-lag /
    `exploration_time`). For one seed, a longer signal begins with the shorter signal. The noise is not clipped; the sum
    of command and noise is clipped later. `rms` is a fraction of the action limit."""
    kept = np.exp(-flow.control_period / forcing.exploration_time)
    white = rng.standard_normal(steps)
    white[1:] *= np.sqrt(1.0 - kept**2)
    signal: Array = rms * flow.action_limit * lfilter([1.0], [1.0, -kept], white)
    return signal


def _sweep(steps: int, start: float, end: float, flow: FlowConfig) -> Array:
    """Compute a linear sweep of the frequency at full amplitude; shape (steps,), in U_inf W."""
    t = np.arange(steps) * flow.control_period
    rate = (end - start) / (max(steps, 1) * flow.control_period)
    return flow.action_limit * np.sin(2.0 * np.pi * (start * t + 0.5 * rate * t**2))


Signal = Callable[[int, ForcingConfig, FlowConfig, np.random.Generator], Array]
SIGNALS: Final[dict[ForcingName, Signal]] = {
    "training": training,
    "chirp": lambda steps, forcing, flow, _: _sweep(steps, forcing.chirp_start, forcing.chirp_end, flow),
    "extended_chirp": lambda steps, forcing, flow, _: _sweep(
        steps, forcing.extended_chirp_start, forcing.extended_chirp_end, flow
    ),
    "none": lambda steps, *_: np.zeros(steps),
}
