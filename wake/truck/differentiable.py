"""The wake and its tape as a plant that gives gradients through the flow solver (`contract.differentiable`)."""

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from contract.arrays import Array, Index
from contract.differentiable import FlowState, Seen
from contract.runtime.copies import CopiedWhole
from wake.plant.drive import at_speed
from wake.truck.state import State
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake

MEMORY_MB: Final = 7000.0
"""Limit of the tape's memory, in 10^6 bytes. The flow of 125 control periods takes 2000 x 10^6 bytes on the mesh of
`stillwake refine` and 6900 x 10^6 on the default mesh. Beyond the limit, the tape computes steps a second time."""
AT_REST: Final = 60.0
"""Time for which the wake without jets settles at a speed: twelve cycles. The average after it has the same duration.
The unit is the convective time at that speed."""


class DifferentiableWake(CopiedWhole):
    """A plant with its tape. It returns the pressures at the sensors of p pairs. `columns` (2 p,) are the indices of
    these sensors in the plant's Cp, pair by pair."""

    def __init__(self, plant: TruckWake, columns: Index) -> None:
        self.plant, self._columns = plant, columns
        self._tape, self._config = Tape(plant, MEMORY_MB), plant.config
        self._speeds = np.ones(1)

    def begin(self, state: FlowState, speeds: Array) -> Seen:
        """Continue from a state with an empty tape. `speeds` (n + 1,) are the speeds at the start and at the samples of
        the n periods, divided by the design speed. A higher largest speed needs more time steps per period."""
        plant, config = self.plant, self._config
        plant.config = at_speed(config, float(speeds.max()))
        times, faster = config.control_period * np.arange(len(speeds), dtype=np.float64), speeds - 1.0
        plant.wind = partial(_between, times=times, values=faster) if faster.any() else None
        plant.reset(State(flat=state.flat, substep=0, action=state.action))
        self._speeds = speeds
        self._tape.restart()
        return self._seen()

    def advance(self, action: float) -> Seen:
        """Advance by a control period, and store it on the tape. Raises PlantError as `Tape.advance` does."""
        self._tape.advance(action)
        return self._seen()

    def back(self, weights: Seen) -> float:
        """Go back by a period, and return a scalar's derivative with respect to the action commanded in this period.
        `weights` are the scalar's derivatives with respect to the period's sample."""
        speed = self._speed
        whole = no_weights(len(self.plant.layout))
        whole.Cp[self._columns] = weights.Cp / speed**2
        Cd, Cl = weights.Cd / speed**2, weights.Cl / speed**2
        return self._tape.back(replace(whole, Cd=Cd, Cl=Cl, Uy_probe=weights.Uy / speed))

    def state(self) -> FlowState:
        """Return the present flow."""
        return FlowState(flat=self.plant.flow.flat.copy(), action=self.plant.action)

    def at_rest(self, state: FlowState, speed: float, over: float = AT_REST) -> tuple[float, float] | None:
        """Return two means without jets: Cp on the base, and the |Cp difference| of sensor pairs. Return None if no
        sensor is on the base. The wake settles for `over` convective times at this speed, and is then averaged over the
        same time."""
        on_base = np.isin(self._columns, self.plant.layout.base)
        if not on_base.any():
            return None
        periods = round(over / speed / self._config.control_period)
        plant = TruckWake(self._config, body=self.plant.body, precision=self.plant.solver.precision)
        plant.config = at_speed(self._config, speed)
        plant.reset(State(flat=state.flat, substep=0, action=0.0))
        plant.scale(speed)
        plant.wind = lambda t: speed - 1.0
        for _ in range(periods):
            plant.advance(0.0)
        rows = np.array([plant.advance(0.0).Cp[self._columns] for _ in range(periods)]) / speed**2
        return float(rows[:, on_base].mean()), float(np.abs(rows[:, ::2] - rows[:, 1::2]).mean())

    @property
    def _speed(self) -> float:
        """The speed at the last sample of the tape, divided by the design speed."""
        return float(self._speeds[len(self._tape)])

    def _seen(self) -> Seen:
        sample, speed = self.plant.sample(), self._speed
        q = speed**2
        return Seen(Cp=sample.Cp[self._columns] / q, Cd=sample.Cd / q, Cl=sample.Cl / q, Uy=sample.Uy_probe / speed)


def _between(t: float, *, times: Array, values: Array) -> float:
    return float(np.interp(t, times, values))
