import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import chirp as scipy_chirp
from scipy.signal import hilbert

from contract.config.plant import FlowConfig, ForcingConfig
from tests.examples import examples
from wake.recording.episode_plan import SIGNALS

FLOW, FORCING = FlowConfig(), ForcingConfig()


@examples(30)
@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(sorted(SIGNALS)), steps=st.integers(1, 400))
def test_every_signal_keeps_the_bound_and_is_repeatable(seed, name, steps):
    first, second = (SIGNALS[name](steps, FORCING, FLOW, np.random.default_rng(seed)) for _ in range(2))
    assert first.shape == (steps,)
    assert np.abs(first).max() <= FLOW.action_limit
    assert np.array_equal(first, second)


def test_signals_are_scipys_and_the_papers():
    steps = 5000
    t = np.arange(steps) * FLOW.control_period
    expected = FLOW.action_limit * scipy_chirp(t, 0.1, steps * FLOW.control_period, 0.4, phi=-90)
    actual = SIGNALS["chirp"](steps, FORCING, FLOW, np.random.default_rng(0))
    assert actual == pytest.approx(expected, abs=1e-9)
    # Training waveform wanders around the shedding frequency.
    signal = SIGNALS["training"](50_000, FORCING, FLOW, np.random.default_rng(1))
    phase = np.unwrap(np.angle(hilbert(signal)))
    frequency = np.diff(phase) / (2 * np.pi * FLOW.control_period)
    assert np.mean(frequency) == pytest.approx(0.2, abs=0.02)
    # The paper: up to 0.45. Modulation 0.25 around 0.2, so nearly all of the time between -0.05 and 0.45.
    assert np.percentile(frequency, 99) < 0.45 and np.percentile(frequency, 99) > 0.28
    # The envelope (period 200 t_c) drives the amplitude between 0.55 and clipping.
    amplitude = np.abs(hilbert(signal)).reshape(-1, 50).mean(axis=1) / FLOW.action_limit
    assert np.percentile(amplitude, 2) < 0.65 and np.percentile(amplitude, 98) > 0.95
