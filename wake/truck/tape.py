"""The sensitivities of a sequence of control periods. The plant's periods are recorded as it advances, then
differentiated backwards, one at a time. So a controller in the loop can be differentiated with the plant."""

from dataclasses import dataclass

import numpy as np

from contract.arrays import Array
from contract.errors import PlantError
from contract.ledger import LEDGER_FIELDS
from contract.runtime.copies import CopiedWhole
from wake.plant.sample import Sample
from wake.solver.adjoint import FlowAdjoint
from wake.solver.flow import Flow
from wake.truck.surface import MOMENTUM_FACTOR, Measured
from wake.truck.truck_wake import TruckWake

_MEGABYTE = 1e6


@dataclass(kw_only=True, eq=False)
class _Period:
    """The actions and the time of a period, the flow at its start and, if memory allows, at each step's start."""

    start: Array
    steps: Array | None
    action_from: float
    action_to: float
    t: float


class Tape(CopiedWhole):
    """A record of a plant's control periods from the present state on. It propagates sensitivities back over these
    periods.

    The flow at the start of each time step is stored. When the memory is full, only the flow at the period's start
    remains for each of the oldest periods; `back` computes these periods a second time. Raises PlantError if the plant
    is within a control period. A copy has its own plant.

    Args:
        plant: plant at the beginning of a control period; its wind must not change.
        memory_mb: limit of the stored data, in 10^6 bytes.

    Attributes:
        bar: sensitivities of a scalar to the flow at the instant that `back` has reached. The scalar is the weighted
            sum of the samples that `back` has passed.
        bar_action: the scalar's sensitivity to the action in force at that instant.
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
        """Advance the plant by a period, as `TruckWake.advance` does, and store the data that `back` needs. Raises
        PlantError as the plant does, or if the tape becomes too long for its memory."""
        plant, substeps = self._plant, self._plant.config.substeps
        flow_mb = self._end.nbytes / _MEGABYTE
        self._make_room(flow_mb, substeps)
        period = _Period(
            start=plant.flow.flat.copy(),
            steps=self._memory(substeps),
            action_from=plant.action,
            action_to=action,
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
        self._weigh(end, period.action_to, weights)
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
        into = self._plant.substeps_into_period
        if into:
            raise PlantError(f"a tape begins with a control period, but the plant is {into} steps into a period")
        self._spare += [period.steps for period in self._periods if period.steps is not None]
        self._periods.clear()
        self.memory_mb = 0.0
        self._end[:] = self._plant.flow.flat
        self.bar.flat[:] = 0.0
        self.bar_action = 0.0

    def _weigh(self, flow: Flow, action: float, weights: Sample) -> None:
        surface = self._plant.surface
        alike = ("Cp", "Cd", "Cl", "Cd_slot_pressure", "Cd_slot_viscous", "Uy_probe")
        blown = weights.jet_power * action
        given = {name: getattr(weights, name) for name in alike}
        surface.weigh(self.bar, flow, Measured(Cp_upper=blown, Cp_lower=-blown, **given))
        self.bar_action += weights.action - 8.0 * MOMENTUM_FACTOR * action * weights.Cd_momentum
        if weights.jet_power:
            measured = surface.measure(flow)
            self.bar_action += weights.jet_power * (measured.Cp_upper - measured.Cp_lower)

    def _memory(self, steps: int) -> Array:
        """Return memory for the flow at each step's start. Memory of earlier periods is reused, because the system
        takes time to map new pages."""
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
