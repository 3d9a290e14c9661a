"""The sensitivities of a sequence of control periods, which are recorded while the plant advances, then differentiated
backwards, one at a time. So a controller in the loop can be differentiated with the plant."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from contract.arrays import Array, Index
from contract.differentiable import FlowState, Seen
from contract.errors import PlantError
from contract.ledger import LEDGER_FIELDS
from contract.runtime.copies import CopiedWhole
from wake.plant.drive import at_speed
from wake.plant.sample import Sample
from wake.solver.adjoint import FlowAdjoint
from wake.solver.grid import Flow
from wake.truck.state import State
from wake.truck.surface import MOMENTUM_FACTOR
from wake.truck.truck_wake import TruckWake


@dataclass(kw_only=True, eq=False)
class _Period:
    """A period's actions, time and flow at its start, and the flow at each step's start if memory allows."""

    start: Array
    steps: Array | None
    action_from: float
    action_to: float
    t: float


class Tape(CopiedWhole):
    """A record of a plant's control periods from the present state on. It propagates sensitivities back over these
    periods.

    The flow at the start of each time step is stored, up to a limit in 10^6 bytes. When the memory is full, only the
    flow at the period's start remains for each of the oldest periods; `back` computes these periods a second time. The
    plant's wind must not change. Raises PlantError if the plant is within a control period. A copy has its own plant.

    Attributes:
        bar, bar_action: sensitivities of a scalar to flow and action at the instant that `back` has reached. The scalar
            is the weighted sum of the samples that `back` has passed.
        memory_mb: size of the data stored since the tape's start, in 10^6 bytes.
    """

    def __init__(self, plant: TruckWake, memory_mb: float = 2000.0) -> None:
        self._plant, self._most_mb = plant, memory_mb
        self._adjoint = FlowAdjoint(plant.solver)
        self._periods: list[_Period] = []
        self._spare: list[Array] = []
        self.memory_mb = 0.0
        self._end = np.empty_like(plant.flow.flat)
        self.bar = Flow.zeros(plant.grid.shape, plant.solver.precision)
        self.bar_action = 0.0
        self.restart()

    def __len__(self) -> int:
        """Return the number of periods that `back` has not passed yet."""
        return len(self._periods)

    def advance(self, action: float) -> Sample:
        """Advance the plant by a period, as `TruckWake.advance` does, and store the data that `back` needs. Call
        `restart` before the first call after `back`. Raises the plant's errors, and PlantError if the tape becomes too
        long for its memory or the plant's flow is not the flow at the tape's end."""
        plant, substeps = self._plant, self._plant.config.substeps
        if not np.array_equal(self._end, plant.flow.flat):
            raise PlantError("the plant is not at the end of the tape: call `restart` before the next window")
        flow_mb = self._end.nbytes / 1e6
        self._make_room(flow_mb, substeps)
        period = _Period(
            start=plant.flow.flat.copy(),
            steps=self._memory(substeps),
            action_from=plant.action,
            action_to=float(action),  # with a NumPy float32, the sensitivities would also be rounded
            t=plant.t,
        )
        plant.advance_to(substeps, action, starts=period.steps)
        self._periods.append(period)
        self.memory_mb += (1 + substeps) * flow_mb
        self._end[:] = plant.flow.flat
        return plant.sample()

    def back(self, weights: Sample) -> float:
        """Go back by a period. `weights` are the derivatives of a scalar with respect to each value of the period's
        sample (`no_weights` has zeros); the time in `weights` is not read. Returns the scalar's sensitivity to the
        action commanded in this period, through this and all later samples. Raises PlantError at the tape's start, or
        if the plant's wind or Reynolds number has changed so that a repeated period diverges."""
        if not self._periods:
            raise PlantError("the backward pass is at the start of the tape: no period is left")
        period, plant = self._periods.pop(), self._plant
        end = Flow.of(self._end, plant.grid.shape)
        surface, action = plant.surface, period.action_to
        surface.weigh(self.bar, end, weights, action)
        self.bar_action += weights.action - 8.0 * MOMENTUM_FACTOR * action * weights.Cd_momentum
        if weights.jet_power:
            upper, lower = surface.jet_pressures(end)
            self.bar_action += weights.jet_power * (upper - lower)
        ramp = {"dt": plant.dt, "action_from": period.action_from, "action_to": period.action_to}
        wind = plant.wind_from(period.t)
        steps = period.steps
        if steps is None:
            steps = self._memory(plant.config.substeps)
            end.flat[:] = period.start
            plant.solver.run(end, steps=len(steps), wind=wind, starts=steps, **ramp)
        to_from, to_to = self._adjoint.run(self.bar, steps, wind=wind, **ramp)
        to_command = self.bar_action + to_to
        self.bar_action = to_from
        self._end[:] = period.start
        self._spare.append(steps)
        return to_command

    def restart(self) -> None:
        """Empty the tape, and begin again at the plant's present state with the same memory. Raises PlantError if the
        plant is within a control period."""
        if into := self._plant.substeps_into_period:
            raise PlantError(f"a tape begins at a control period's start, but the plant is {into} steps after it")
        self._spare += [period.steps for period in self._periods if period.steps is not None]
        self._periods.clear()
        self.memory_mb = 0.0
        self._end[:] = self._plant.flow.flat
        self.bar.flat[:] = 0.0
        self.bar_action = 0.0

    def _memory(self, steps: int) -> Array:
        """Return memory for `steps` flows. It is reused, because the system takes time to map new pages."""
        while self._spare:
            if len(spare := self._spare.pop()) == steps:
                return spare
        return np.empty((steps, self._end.size), self._end.dtype)

    def _make_room(self, flow_mb: float, substeps: int) -> None:
        needed_mb = (1 + substeps) * flow_mb
        for period in self._periods:
            if self.memory_mb + needed_mb <= self._most_mb:
                return
            if period.steps is not None:
                self._spare.append(period.steps)
                period.steps = None
                self.memory_mb -= substeps * flow_mb
        if self.memory_mb + needed_mb > self._most_mb:
            raise PlantError(
                f"the tape holds {len(self._periods)} periods, and another period of {needed_mb:.3g} MB does not fit "
                f"into {self._most_mb:g} MB: end the window here, or allow more memory"
            )


def no_weights(sensors: int) -> Sample:
    """Return a sample with weights of zero for `sensors` sensors; the caller replaces the weights that are not zero."""
    zeros = dict.fromkeys((*LEDGER_FIELDS, "t", "Uy_probe", "action"), 0.0)
    return Sample(Cp=np.zeros(sensors), **zeros)


MEMORY_MB: Final = 7000.0
"""Limit of the tape's memory, in 10^6 bytes. The flow of 125 control periods takes 2000 x 10^6 bytes on the mesh of
`stillwake refine` and 6900 x 10^6 on the default mesh. Beyond the limit, the tape computes steps a second time."""
AT_REST: Final = 60.0
"""Time in which the wake without jets settles (twelve cycles), and then is averaged, in t_c at its speed."""


class DifferentiableWake(CopiedWhole):
    """A plant with its tape. The samples have the pressures at the sensors of p pairs. `columns` (2 p,) are the indices
    of these sensors in the plant's Cp, pair by pair."""

    def __init__(self, plant: TruckWake, columns: Index) -> None:
        self.plant, self._columns = plant, columns
        self._tape, self._config = Tape(plant, MEMORY_MB), plant.config
        self._speeds = np.ones(1)

    def begin(self, state: FlowState, speeds: Array) -> Seen:
        """Continue from a state with an empty tape. `speeds` (n + 1,) are the speeds at the start and at the samples of
        the n periods, divided by the design speed. The largest speed determines the number of time steps per period."""
        plant, config = self.plant, self._config
        plant.config = at_speed(config, float(speeds.max()))
        times, faster = config.control_period * np.arange(len(speeds), dtype=np.float64), speeds - 1.0
        plant.wind = partial(np.interp, xp=times, fp=faster) if faster.any() else None
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
        speed = float(self._speeds[len(self._tape)])
        whole = no_weights(len(self.plant.layout))
        whole.Cp[self._columns] = weights.Cp / speed**2
        Cd, Cl = weights.Cd / speed**2, weights.Cl / speed**2
        return self._tape.back(replace(whole, Cd=Cd, Cl=Cl, Uy_probe=weights.Uy / speed))

    def state(self) -> FlowState:
        """Return the present flow."""
        return FlowState(flat=self.plant.flow.flat.copy(), action=self.plant.action)

    def at_rest(self, state: FlowState, speed: float, over: float = AT_REST) -> tuple[float, float] | None:
        """Return two means for the wake without jets: Cp on the base, and the |Cp difference| of sensor pairs. Return
        None if no sensor is on the base. The wake settles for `over` convective times and is averaged as long."""
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

    def _seen(self) -> Seen:
        sample, speed = self.plant.sample(), float(self._speeds[len(self._tape)])
        q = speed**2
        return Seen(Cp=sample.Cp[self._columns] / q, Cd=sample.Cd / q, Cl=sample.Cl / q, Uy=sample.Uy_probe / speed)
