"""Plants whose best action is known."""

from typing import Any

import numpy as np

from wake.plant.sample import Sample


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
