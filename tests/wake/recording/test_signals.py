"""The jet signals of recordings, against SciPy, the paper and the processes they are drawn from."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import chirp as scipy_chirp
from scipy.signal import hilbert

from contract.config.plant import FlowConfig, ForcingConfig
from contract.config.tree import Config
from contract.errors import ConfigError
from tests.examples import examples
from wake.recording.plans import SIGNALS, CalmRound, ControlledRound, exploration

FLOW, FORCING = FlowConfig(), ForcingConfig()
NO_BUNDLE: dict[str, Any] = {"bundle": "none", "bundle_digest": "0" * 64}


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


@pytest.mark.slow  # long signals
def test_exploration_has_the_variance_and_the_memory_it_should():
    limit = FLOW.action_limit
    for time in [0.4, 1.0, 3.0]:
        n, rms = 400_000, 0.15
        x = exploration(n, ForcingConfig(exploration_time=time), FLOW, np.random.default_rng(3), rms=rms) / limit
        # Independent samples that tell as much: n (1 - r^2) / (1 + r^2), 27,000 at least; four standard errors.
        r = np.exp(-0.2 / time)
        few = n * (1 - r**2) / (1 + r**2)
        assert x.mean() == pytest.approx(0.0, abs=4 * rms * np.sqrt((1 + r) / (1 - r) / n))
        assert x.std() == pytest.approx(rms, rel=4 / np.sqrt(2 * few))
        for lag in (1, 2, 5, 10):
            # Of an Ornstein-Uhlenbeck process: exp(-lag / time).
            expected = pytest.approx(np.exp(-0.2 * lag / time), abs=4 / np.sqrt(few))
            assert np.corrcoef(x[:-lag], x[lag:])[0, 1] == expected
        # Gaussian: 4.55 % beyond two standard deviations.
        assert np.mean(np.abs(x) > 2 * rms) == pytest.approx(0.0455, abs=4 * np.sqrt(0.0455 / few))
    runs = np.array([exploration(4, FORCING, FLOW, np.random.default_rng(i), rms=0.5) for i in range(3000)])
    # Four standard errors of a standard deviation from 3000 values.
    assert runs.std(axis=0) / limit == pytest.approx(np.full(4, 0.5), rel=4 / np.sqrt(6000))
    # Calm episodes have the amplitudes asked for.
    plans = CalmRound(episodes=4, steps=100_000, smallest=0.001, largest=0.008).plans(1)
    assert [plan.provenance["amplitude"] for plan in plans] == pytest.approx([0.001, 0.002, 0.004, 0.008])
    amplitudes = [np.sqrt(np.mean(plan.signal(Config()) ** 2)) for plan in plans]
    # A correlation time of five steps leaves some 20,000 independent values: four standard errors of a deviation.
    assert amplitudes == pytest.approx([0.001, 0.002, 0.004, 0.008], rel=4 / np.sqrt(2 * 20_000))


def test_no_two_episodes_are_disturbed_alike():
    kinds: list[tuple[Any, dict[str, Any], str]] = [(ControlledRound, NO_BUNDLE, "controlled"), (CalmRound, {}, "calm")]
    for kind, of, own in kinds:
        wanted = [kind(**of, **{"steps": 8, **changes}) for changes in ({}, {"seed": 2}, {"role": own})]
        plans = [plan for item in wanted for number in (1, 2) for plan in item.plans(number)]
        signals = np.array([plan.signal(Config()) for plan in plans])
        signals /= np.linalg.norm(signals, axis=1, keepdims=True)
        assert len(np.unique(signals.round(9), axis=0)) == len(plans), own
    # Every control step of a shedding cycle once.
    assert sorted(plan.lead for plan in ControlledRound(episodes=24, **NO_BUNDLE).plans(1)) == list(range(24))
    fast = replace(FORCING, modulation_cutoff=0.5 / FLOW.control_period)
    with pytest.raises(ConfigError, match=r"modulation_cutoff = 2\.5: must be below 2\.5, half the control rate"):
        SIGNALS["training"](8, fast, FLOW, np.random.default_rng(1))
    with pytest.raises(ConfigError, match="role = 'test': must be one of train, calm"):
        CalmRound(role="test")  # type: ignore[arg-type]  # a role of no round
