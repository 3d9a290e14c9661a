"""Each formula against its definition, alone and in the loop with an oscillator."""

import numpy as np
import pytest

from benchmarks.roads.laws import BangBang, Constant, Opposition, PhaseControl, Proportional, Sine
from benchmarks.roads.loop import LawController, on_plant
from benchmarks.roads.mpc_90 import Windowed
from firmware_sim.bench.spans import Spans
from wake.plant.sample import Sample

PERIOD = 0.2
SPANS = Spans(lead_in=10.0, controlled=40.0, settle=20.0)


def window(signal: np.ndarray) -> np.ndarray:
    """Two pressures that differ by the signal, beside an offset that both have, and an action."""
    common = 0.3 * np.cos(np.arange(len(signal))) - 0.4
    return np.stack([common + 0.5 * signal, common - 0.5 * signal, np.zeros_like(signal)], axis=1)


class Spring:
    """x'' = -x + c a, exactly over a period for the mean action; pressures +-x / 2, so that their difference is x."""

    def __init__(self, gain: float) -> None:
        self.x, self.v, self.gain, self.step, self.action = 1.0, 0.0, gain, 0, 0.0
        self.acted: list[float] = []

    def sample(self) -> Sample:
        return Sample(
            t=PERIOD * self.step,
            Cp=np.array([0.5 * self.x, -0.5 * self.x]),
            Cd=1.0 + self.x**2,
            Cl=self.v,
            Cd_slot_pressure=0.0,
            Cd_slot_viscous=0.0,
            Cd_momentum=0.0,
            jet_power=0.0,
            Uy_probe=0.0,
            action=self.action,
        )

    def advance(self, action: float) -> Sample:
        rest = 0.5 * self.gain * (self.action + action)
        turn = np.exp(-1j * PERIOD) * ((self.x - rest) + 1j * self.v)
        self.x, self.v = rest + turn.real, turn.imag
        self.action, self.step = action, self.step + 1
        self.acted.append(action)
        return self.sample()

    @property
    def energy(self) -> float:
        return 0.5 * (self.x**2 + self.v**2)


def closed(law, gain: float = 1.0) -> Spring:
    plant = Spring(gain)
    on_plant(plant, Windowed(law, length=32, sensors=2), spans=SPANS, control_period=PERIOD, limit=0.5)
    return plant


def test_constant_and_sine_are_theirs_whatever_is_seen():
    rng = np.random.default_rng(0)
    assert Constant(action=0.03)(window(rng.standard_normal(8)), 0.0) == 0.03
    sine = Sine(amplitude=0.075, frequency=0.2, phase=0.5, period=PERIOD)
    found = [sine(window(rng.standard_normal(8)), 0.0) for _ in range(50)]
    assert found == pytest.approx(0.075 * np.sin(0.5 + 2 * np.pi * 0.2 * PERIOD * np.arange(50)))


def test_proportional_takes_the_difference_so_long_ago():
    signal = np.random.default_rng(1).standard_normal(20)
    law = Proportional(gain=-0.4, delay=3, columns=(0, 1))
    assert law(window(signal), 0.0) == pytest.approx(-0.4 * signal[-4])


def test_opposition_is_against_the_rate():
    t = PERIOD * np.arange(20)
    law = Opposition(gain=0.1, columns=(0, 1), period=PERIOD, over=2)
    assert law(window(0.7 * t - 3.0), 0.0) == pytest.approx(-0.07)


@pytest.mark.parametrize("phase", [0.0, 1.0, 3.0, -2.0])
def test_the_phase_is_that_of_a_sine_beside_an_offset(phase):
    law = PhaseControl(amplitude=0.04, shift=0.3, columns=(0, 1), period=PERIOD)
    back = 2 * np.pi * 0.2 * PERIOD * np.arange(-31, 1)
    signal = 0.1 + 0.8 * np.sin(phase + back)
    assert law.phase(signal) == pytest.approx(phase, abs=1e-9)
    assert law(window(signal), 0.0) == pytest.approx(0.04 * np.sin(phase + 0.3))


def test_bang_bang_has_the_sign_of_the_other_and_a_dead_zone():
    for wanted, expected in ((0.03, 0.075), (-0.011, -0.075), (0.009, 0.0), (-0.01, 0.0)):
        law = BangBang(Constant(action=wanted), limit=0.075, dead=0.01)
        assert law(window(np.zeros(4)), 0.0) == expected


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_opposition_damps_an_oscillator_and_its_opposite_drives_it(sign):
    plant = closed(Opposition(gain=sign * 0.2, columns=(0, 1), period=PERIOD))
    # Of x'' + 0.2 x' + x = 0 over 40 t_c: exp(-8); the delay of the loop and the rate's own change the rate somewhat.
    assert plant.energy < 0.5 * np.exp(-4.0) if sign > 0 else plant.energy > 0.5 * np.exp(2.0)


def test_a_command_acts_one_period_after_the_sample_it_is_made_of():
    seen: list[float] = []

    def law(rows: np.ndarray, committed: float) -> float:
        seen.append(committed)
        return 0.01 * (len(seen))

    plant = closed(law)
    lead_in, total = SPANS.periods(PERIOD)
    assert plant.acted[: lead_in + 1] == [0.0] * (lead_in + 1)
    assert plant.acted[lead_in + 1 : lead_in + 4] == pytest.approx([0.01, 0.02, 0.03])
    assert seen[:3] == pytest.approx([0.0, 0.01, 0.02]) and len(plant.acted) == total
    assert max(plant.acted) == 0.5


def test_as_the_ecu_s_controller_a_law_keeps_what_is_committed():
    controller = LawController(Constant(action=0.2), horizon=5, limit=0.075, description="x")
    step = controller.control_step(np.zeros((4, 3)), np.array([9.0, 0.01, 9.0, 9.0, 9.0]), np.ones(5))
    assert step.plan.tolist() == [0.01, 0.075, 0.075, 0.075, 0.075]
