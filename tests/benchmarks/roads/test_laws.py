"""Control laws against their definitions, alone and in the loop with an oscillator."""

import numpy as np
import pytest

from benchmarks.roads.laws import BangBang, Constant, Opposition, PhaseControl, Proportional, Sine
from benchmarks.roads.loop import LawController, on_plant
from benchmarks.roads.mpc_90 import Windowed
from firmware_sim.bench.spans import Spans
from tests.benchmarks.roads.plants import Spring

PERIOD = 0.2
SPANS = Spans(lead_in=10.0, controlled=40.0, settle=20.0)


def window(signal: np.ndarray) -> np.ndarray:
    """Two pressures that differ by the signal and share an offset, and an action."""
    common = 0.3 * np.cos(np.arange(len(signal))) - 0.4
    return np.stack([common + 0.5 * signal, common - 0.5 * signal, np.zeros_like(signal)], axis=1)


def closed(law) -> Spring:
    plant = Spring(PERIOD)
    on_plant(plant, Windowed(law, length=32, sensors=2), spans=SPANS, control_period=PERIOD, limit=0.5)
    return plant


def test_each_law_is_its_formula():
    signal, t = np.random.default_rng(1).standard_normal(20), PERIOD * np.arange(20)
    assert Constant(action=0.03)(window(signal), 0.0) == 0.03
    sine = Sine(amplitude=0.075, frequency=0.2, phase=0.5, period=PERIOD)
    actions = [sine(window(signal), 0.0) for _ in range(50)]
    assert actions == pytest.approx(0.075 * np.sin(0.5 + 2 * np.pi * 0.2 * PERIOD * np.arange(50)))
    proportional = Proportional(gain=-0.4, delay=3, columns=(0, 1))
    assert proportional(window(signal), 0.0) == pytest.approx(-0.4 * signal[-4])
    opposition = Opposition(gain=0.1, columns=(0, 1), period=PERIOD, over=2)
    assert opposition(window(0.7 * t - 3.0), 0.0) == pytest.approx(-0.07)
    for asked, expected in ((0.03, 0.075), (-0.011, -0.075), (0.009, 0.0), (-0.01, 0.0)):
        assert BangBang(Constant(action=asked), limit=0.075, dead=0.01)(window(signal), 0.0) == expected, asked


def test_the_phase_is_that_of_a_sine_with_an_offset():
    law = PhaseControl(amplitude=0.04, shift=0.3, columns=(0, 1), period=PERIOD)
    for phase in (0.0, 1.0, 3.0, -2.0):
        signal = 0.1 + 0.8 * np.sin(phase + 2 * np.pi * 0.2 * PERIOD * np.arange(-31, 1))
        assert law.phase(signal) == pytest.approx(phase, abs=1e-9), phase
        assert law(window(signal), 0.0) == pytest.approx(0.04 * np.sin(phase + 0.3)), phase


def test_opposition_damps_an_oscillator_and_its_opposite_drives_it():
    damped, driven = (closed(Opposition(gain=gain, columns=(0, 1), period=PERIOD)) for gain in (0.2, -0.2))
    # x'' + 0.2 x' + x = 0 over 40 t_c gives exp(-8); the delay of the loop changes the rate somewhat.
    assert damped.energy < 0.5 * np.exp(-4.0) and driven.energy > 0.5 * np.exp(2.0)


def test_a_command_acts_one_period_after_its_sample():
    seen: list[float] = []

    def law(rows: np.ndarray, committed: float) -> float:
        seen.append(committed)
        return 0.01 * (len(seen))

    plant = closed(law)
    lead_in, total = SPANS.periods(PERIOD)
    assert plant.acted[: lead_in + 4] == pytest.approx([0.0] * (lead_in + 1) + [0.01, 0.02, 0.03])
    assert seen[:3] == pytest.approx([0.0, 0.01, 0.02]) and len(plant.acted) == total
    assert max(plant.acted) == 0.5


def test_as_the_controller_of_an_ecu_a_law_keeps_what_is_committed():
    controller = LawController(Constant(action=0.2), horizon=5, limit=0.075, description="x")
    step = controller.control_step(np.zeros((4, 3)), np.array([9.0, 0.01, 9.0, 9.0, 9.0]), np.ones(5))
    assert step.plan.tolist() == [0.01, 0.075, 0.075, 0.075, 0.075]
