"""An example of your own plant in the closed loop: an oscillator with a limit cycle (docs/how-to/add-a-plant.md)."""

import numpy as np

from contract.config.plant import FlowConfig
from contract.sensors import TRUCK
from wake.plant.sample import Sample

GROWTH, FREQUENCY, PUSH = 0.1, 0.2, 4.0  # in 1/t_c; PUSH also per unit of action


class OscillatorPlant:
    """A plant whose state z follows dz/dt = (s + i w) z - s abs(z)^2 z + k a; s is GROWTH, w is 2 pi FREQUENCY, k is
    PUSH, a is the action. The drag grows with abs(z)^2; side force and pressure deviations are linear in z."""

    layout = TRUCK
    description = "Stuart-Landau oscillator"

    def __init__(self, config: FlowConfig) -> None:
        self._config = config
        self._dt = config.control_period / config.substeps
        self._steps, self._z, self._action = 0, 1.0 + 0j, 0.0
        x, y = TRUCK.positions.T
        self._mean = -0.2 - 0.2 * np.isin(np.arange(len(TRUCK)), TRUCK.base)
        self._shape = 0.3 * np.sign(y) * np.exp(0.8j * (x - x.max()))

    def sample(self) -> Sample:
        z = self._z
        return Sample(
            t=self._steps * self._dt,
            Cp=self._mean + np.real(self._shape * z),
            Cd=0.65 + 0.38 * abs(z) ** 2,
            Cl=1.3 * z.real,
            Cd_slot_pressure=0.0,
            Cd_slot_viscous=0.0,
            Cd_momentum=0.0,
            jet_power=0.0,
            Uy_probe=0.7 * z.imag,
            action=self._action,
        )

    def advance_to(self, substep: int, action: float | None = None) -> None:
        into, last = self._steps % self._config.substeps, self._config.substeps
        target = self._action if action is None else action
        for left in range(last - into, last - substep, -1):
            self._action += (target - self._action) / left
            rate = GROWTH * (1 - abs(self._z) ** 2) + 2j * np.pi * FREQUENCY
            self._z += self._dt * (rate * self._z + PUSH * self._action)
            self._steps += 1
