"""What control is worth, as the loop runs: the mean drag without it, and that of the latest shedding cycle."""

from collections import deque

import numpy as np

from contract.errors import PlantError
from firmware_sim.bench.spans import SHEDDING_TIME
from wake.plant.sample import Sample
from wake.truck.averages import over_cycles, over_last_cycles


class DragMeans:
    """Mean drag of one run of the loop.

    Args:
        control_period: t_c.
        kept: samples that are remembered.

    Attributes:
        uncontrolled: mean Cd over the whole cycles before control was first requested; None without one.
        now: mean Cd over the latest cycle; None before there was one.
    """

    def __init__(self, control_period: float, kept: int) -> None:
        self._period = control_period
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=kept)
        self._frequency = 1.0 / SHEDDING_TIME
        self.uncontrolled: float | None = None
        self.now: float | None = None

    def add(self, sample: Sample) -> None:
        """Add the sample of a period's start."""
        self._samples.append((sample.t, sample.Cd, sample.Cl))

    def update(self, *, without_control: bool) -> None:
        """Average again. With `without_control` also the mean without control, up to the sample at which it is
        requested."""
        if without_control:
            t, drag, lift = np.array(self._samples, dtype=float).T
            try:
                average = over_cycles(t, lift)
            except PlantError:
                self.uncontrolled = None
            else:
                self.uncontrolled, self._frequency = float(average.mean(drag)), average.frequency
        needed = int(1.0 / (self._frequency * self._period)) + 3
        latest = np.array([self._samples[at] for at in range(-min(needed, len(self._samples)), 0)], dtype=float)
        try:
            # Of less than two cycles: one.
            self.now = float(over_last_cycles(latest[:, 0], self._frequency).mean(latest[:, 1]))
        except PlantError:
            self.now = None

    @property
    def reduction_percent(self) -> float | None:
        """By which the present mean is below the uncontrolled one; None where one of them is missing."""
        if self.uncontrolled is None or self.now is None:
            return None
        return 100.0 * (1.0 - self.now / self.uncontrolled)
