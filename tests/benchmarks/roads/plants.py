"""Plants whose best action is known."""

from typing import Any

import numpy as np

from wake.plant.sample import Sample
from wake.truck.state import State


def sample(t: float, action: float, **given: Any) -> Sample:
    rest = dict.fromkeys(
        ("Cd", "Cl", "Cd_slot_pressure", "Cd_slot_viscous", "Cd_momentum", "jet_power", "Uy_probe"), 0.0
    )
    return Sample(**{"t": t, "action": action, "Cp": np.zeros(1), **rest, **given})


class Spring:
    """x'' = -x + a, exact over a period for the mean action; pressures +-x / 2, so that their difference is x."""

    def __init__(self, period: float) -> None:
        self.x, self.v, self.step, self.action, self.period = 1.0, 0.0, 0, 0.0, period
        self.acted: list[float] = []

    def sample(self) -> Sample:
        pressures = np.array([0.5 * self.x, -0.5 * self.x])
        return sample(self.period * self.step, self.action, Cp=pressures, Cd=1.0 + self.x**2, Cl=self.v)

    def advance(self, action: float) -> Sample:
        rest = 0.5 * (self.action + action)
        turned = np.exp(-1j * self.period) * ((self.x - rest) + 1j * self.v)
        self.x, self.v = rest + turned.real, turned.imag
        self.action, self.step = action, self.step + 1
        self.acted.append(action)
        return self.sample()

    @property
    def energy(self) -> float:
        return 0.5 * (self.x**2 + self.v**2)


class Valley:
    """Drag (a - best)^2 of the action at the end of a period, and nothing else."""

    def __init__(self, best: float) -> None:
        self.best, self.action, self.step = best, 0.0, 0

    def state(self) -> State:
        return State(flat=np.zeros(1), substep=self.step, action=self.action)

    def reset(self, state: State) -> Sample:
        self.step, self.action = state.substep, state.action
        return self.sample()

    def advance(self, action: float) -> Sample:
        self.action, self.step = action, self.step + 1
        return self.sample()

    def sample(self) -> Sample:
        return sample(0.2 * self.step, self.action, Cd=(self.action - self.best) ** 2)


class Repaying:
    """Cd is 1, more while the jets act, and 0.5 for good `after` periods after they blew upwards."""

    def __init__(self, after: int = 12) -> None:
        self.step, self.action, self.kicked, self.after = 0, 0.0, -1.0, after

    def state(self) -> State:
        return State(flat=np.array([self.kicked]), substep=self.step, action=self.action)

    def reset(self, state: State) -> Sample:
        self.step, self.action, self.kicked = state.substep, state.action, float(state.flat[0])
        return self.sample()

    def advance(self, action: float) -> Sample:
        self.step, self.action = self.step + 1, action
        if action > 0.01 and self.kicked < 0:
            self.kicked = float(self.step)
        return self.sample()

    def sample(self) -> Sample:
        calm = 0.0 <= self.kicked <= self.step - self.after
        return sample(0.2 * self.step, self.action, Cd=(0.5 if calm else 1.0) + 5.0 * abs(self.action))
