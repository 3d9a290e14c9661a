"""Disturbances as text: what they describe, what is refused, and that nothing is lost on the way back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.config.tree import Config
from contract.errors import ConfigError
from contract.recording import dataset
from contract.shipped import RECORDING
from firmware_sim.bench.disturbances import KINDS, Disturbances, NodeFault, WrongClock
from firmware_sim.bench.sensor_faults import GLOBAL_DEVIATION, Bias, Dead, Drift, Noise, Quantise, Stuck, Swap
from tests.examples import examples

SENSORS = ("lower_36", "base_7", "upper_39", "base_0")
TEXTS = (
    *("noise:level=0.5", "bias:sensor=base_7,level=-0.5@1..2", "drift:sensor=base_7,level=1,over_s=2@1.."),
    *("stuck:sensor=upper_39", "dead:sensor=base_7", "swap:sensors=base_0+base_7", "quantise:step=5"),
    *("wire_errors:bit_error_rate=0.001,node=ecu,at=receive", "reset@4", "reset:boot_s=0.5@4", "no_request@2..2.1"),
    *("clock:ppm=-200", "clock:offset_s=0.1@1..2", "reynolds=700", "body:length=1"),
    *("body:length=3,leading_edge_radius=0.25", "gust:amplitude=0.1,period=20", "operating_point:speed=30"),
    *("operating_point:speed=30,density=1.3@1..", "action_limit=0.5", "stuck_jets=-0.5", "speed_scale=1.1@1.."),
    *("speed_late=0.5", "speed_frozen@1..2", "no_speed@0..2", "density:density=1.05,stated=true"),
    "ecu:drop:probability=0.3@1..",
)
"""As they are written back. `test_simulation.py` shows what each of them does."""
SECONDS = st.floats(0, 1e6).filter(lambda s: s == 0 or s > 1e-45)
READINGS = np.random.default_rng(1).standard_normal((4000, 2))


@examples(50)
@given(st.lists(st.sampled_from(TEXTS)), SECONDS, st.floats(0, 1e3), st.floats(1e-5, 1e9))
def test_many_are_read_back_from_their_texts(texts, start_s, lasts_s, ppm):
    odd = WrongClock(ppm=ppm, start_s=start_s, end_s=start_s + lasts_s)
    several = Disturbances(items=(*Disturbances.parse(texts).items, odd))
    assert several.texts[:-1] == tuple(texts)
    assert Disturbances.parse(several.texts) == several


def test_each_is_read_from_its_text_and_what_makes_no_sense_or_could_not_act_is_refused_with_the_reason():
    every = Disturbances.parse(TEXTS)
    assert every.texts == TEXTS
    assert {type(one) for one in every.items} == {NodeFault, *KINDS.values()}
    for text, message in (
        ("", "no disturbance ''; there are noise, bias"),
        ("nose:level=1", "no disturbance 'nose'"),
        ("noise", "noise needs level"),
        ("noise:level=-1", r"noise\.level = -1\.0: must be non-negative"),
        ("drift:sensor=base_7,level=1,over_s=0", r"drift\.over_s = 0\.0: must be positive"),
        ("swap:sensors=base_7+base_7", r"swap\.sensors = \('base_7', 'base_7'\): must be two different sensors"),
        ("wire_errors:bit_error_rate=2", r"bit_error_rate = 2\.0: must be in \[0, 1\]"),
        ("wire_errors:bit_error_rate=1,node=both", "node = 'both' must be all or vehicle or ecu"),
        ("noise:level=0.5,level=1", "level is given twice"),
        ("no_speed=1", "'no_speed=1' must be left out"),
        ("reset@1..2", r"'1\.\.2' must be a time in seconds"),
        ("body:length=1@2..", r"body\.start_s = 2\.0: must be left out, like the end: a body stays"),
        ("body:length=20", r"body\.length = 20\.0: must be in 0\.5\.\.15"),
        ("body:length=1,leading_edge_radius=0.6", r"body\.leading_edge_radius = 0\.6: must be in 0\.\.0\.5"),
        ("gust:amplitude=0.5,period=20", r"gust\.amplitude = 0\.5: must be above 0 and below 0\.5"),
        ("density:density=0.001", r"operating_point\.density = 0\.001: must be in 0\.01\.\."),
        ("operating_point@0.5..", r"operating_point\.speed = None: must be a number, unless density is given"),
        ("operating_point:speed=1001", r"operating_point\.speed = 1001\.0: must be in 0\.01\.\.1000"),
        ("operating_point:density=1e5", r"operating_point\.density = 100000\.0: must be in 0\.01\.\."),
        ("stuck_jets=-1.5", r"stuck_jets = -1\.5: must be between -1 and 1"),
        ("action_limit=1.5", r"action_limit = 1\.5: must be above 0 and at most 1"),
        ("ecu:drip", "no fault 'drip'"),
        ("ECU:babble", "no disturbance 'ECU'"),
        ("ecu:disconnect:kind=device_gone", "would end the run with an error"),
        ("noise:level=1@1..", r"'noise:level=1@1\.\.': begins after the end of the run \(1 s\)"),
        ("ecu:drop:probability=1@1..", "begins after the end of the run"),
        ("dead:sensor=base_1", r"base_1 must be a sensor of the bundle \(lower_36, base_7, upper_39, base_0\)"),
        ("gust:amplitude=0.1,period=5@0..0.4", r"lasts 0\.4 s; it must last at least one period of 0\.5 s"),
    ):
        with pytest.raises(ConfigError, match=message):
            Disturbances.parse([text]).check(Config(), SENSORS, duration_s=1.0)


@pytest.mark.slow  # reads the recording
def test_the_unit_of_levels_is_the_global_deviation_of_the_recording():
    pressures = np.vstack([one.series["Cp"] for one in dataset.read(RECORDING).with_role("train")])
    about_their_means = pressures - pressures.mean(axis=0)
    # The scaling of a training counts mirror images, too: sensors that mirror each other share a mean. To four digits.
    assert np.sqrt((about_their_means**2).mean()) == pytest.approx(GLOBAL_DEVIATION, abs=1e-4)


def test_frame_by_frame_is_as_at_once_and_the_argument_stays():
    readings = READINGS[:80]
    before = readings.copy()
    for one, at in (
        (Noise(level=0.5), ()),
        (Bias(sensor="", level=0.5), (1,)),
        (Drift(sensor="", level=0.5, over_s=1.0), (0,)),
        (Stuck(sensor=""), (0,)),
        (Dead(sensor=""), (1,)),
        (Swap(sensors=("a", "b")), (0, 1)),
        (Quantise(step=5.0), ()),
    ):
        at_once, singly, halved = (one.begun(at, Config(), 2) for _ in range(3))
        expected = at_once(readings)
        np.testing.assert_array_equal(np.stack([singly(frame) for frame in readings]), expected, strict=True)
        np.testing.assert_array_equal(np.vstack([halved(readings[:20]), halved(readings[20:])]), expected)
        np.testing.assert_array_equal(readings, before)


def test_a_drift_of_less_than_a_period_or_of_years_is_one():
    for over_s, expected in ((0.001, [0.0, 1.0, 1.0]), (1e11, [0.0, 2e-13, 4e-13])):
        drift = Drift(sensor="", level=1.0, over_s=over_s).begun((0,), Config(), 0)
        assert drift(np.zeros((3, 1)))[:, 0] / GLOBAL_DEVIATION == pytest.approx(expected), over_s


def test_noise_has_its_size_and_depends_on_the_seed():
    fault, same, other = (Noise(level=0.5).begun((), Config(), seed) for seed in (2, 2, 3))
    change = fault(READINGS) - READINGS
    # 4,000 draws: the deviation of a standard deviation is 1.1 %
    assert change.std(axis=0) == pytest.approx([0.5 * GLOBAL_DEVIATION] * 2, rel=0.05)
    assert abs(np.asarray(np.corrcoef(change.T))[0, 1]) < 0.06
    np.testing.assert_array_equal(same(READINGS) - READINGS, change)
    assert not np.array_equal(other(READINGS) - READINGS, change)
    assert not np.array_equal(fault(READINGS) - READINGS, change)
