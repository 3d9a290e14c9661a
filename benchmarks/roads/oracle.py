"""Model predictive control whose model is the flow itself: what a perfect model would make of a horizon.

The plan is a line through knots, the first one the action in force. Every few periods the plant is stepped over the
horizon from where it stands, once as planned and once with each knot moved a little; the plan takes the best of some
steps down that gradient, none included, so that it never becomes worse than the one before, shifted. Then the plant is
put back and goes on. The cost is the release's.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from contract.arrays import Array
from contract.atomic import replacing
from contract.config.controller import MpcConfig
from export.reference.cost import cost_terms
from wake.plant.sample import Sample
from wake.truck.state import State

Cost = Callable[[Array], float]
"""The cost of the values at the knots, (n,)."""


class Model(Protocol):
    """A plant that can be put back to where it was."""

    def state(self) -> State: ...
    def reset(self, state: State) -> Sample: ...
    def advance(self, action: float) -> Sample:
        """Ramp to the action over a control period; the sample at its end."""


@dataclass(frozen=True, kw_only=True)
class Oracle:
    """How it plans.

    Attributes:
        knots: periods from now at which the plan has its values, rising; the last one is the horizon. Between them it
            is a line.
        every: periods from one planning to the next.
        difference: by which a knot is moved for the gradient, U_inf W.
        steps: lengths of the steps that are tried, U_inf W: root mean square over the knots.
        iterations: gradients of a planning.
        limit: of the action.
        mpc: drag reference and weights of the cost.
    """

    knots: tuple[int, ...]
    every: int
    difference: float
    steps: tuple[float, ...]
    iterations: int
    limit: float
    mpc: MpcConfig

    @property
    def horizon(self) -> int:
        return self.knots[-1]

    @property
    def rollouts(self) -> int:
        """Over the horizon, of a planning."""
        return 1 + self.iterations * (len(self.knots) + len(self.steps))

    def actions(self, values: Array, now: float) -> Array:
        """The plan a_t .. a_{t+H-1} of the values (n,), with `now` in force, (H,)."""
        return np.asarray(np.interp(np.arange(1, self.horizon + 1), (0, *self.knots), (now, *values)))

    def shifted(self, values: Array, now: float) -> Array:
        """The values of the same plan `every` periods later, (n,); beyond its end it stays."""
        return np.asarray(np.interp(np.array(self.knots) + self.every, (0, *self.knots), (now, *values)))

    def cost(self, plant: Model, start: State, values: Array) -> float:
        """The cost of a plan from that state; the plant is left somewhere."""
        plant.reset(start)
        actions = self.actions(values, start.action)
        samples = [plant.advance(float(action)) for action in actions]
        forces = np.array([(sample.Cd, sample.Cl) for sample in samples])
        terms = cost_terms(forces, actions, start.action, self.mpc.drag_reference)
        return float(terms @ np.array(self.mpc.weights.as_tuple()))

    def planned(self, plant: Model, values: Array) -> Array:
        """Better values from where the plant stands, where it is put back."""
        start = plant.state()
        found = descend(
            lambda tried: self.cost(plant, start, tried),
            values,
            difference=self.difference,
            steps=self.steps,
            iterations=self.iterations,
            limit=self.limit,
        )
        plant.reset(start)
        return found


def descend(
    cost: Cost, values: Array, *, difference: float, steps: Sequence[float], iterations: int, limit: float
) -> Array:
    """The best of steps down the gradient by one-sided differences, within +-limit; none is worse than the start.

    Args:
        steps: lengths that are tried, root mean square over the values.
    """
    best = cost(values)
    for _ in range(iterations):
        slope = np.empty_like(values)
        for k in range(len(values)):
            # Away from the bound that it may lie on.
            moved, by = values.copy(), -difference if values[k] > 0.0 else difference
            moved[k] += by
            slope[k] = (cost(moved) - best) / by
        size = float(np.sqrt(np.mean(slope**2)))
        if size == 0.0:
            return values
        tried = [np.clip(values - step / size * slope, -limit, limit) for step in steps]
        costs = [cost(one) for one in tried]
        if min(costs) < best:
            best = min(costs)
            values = tried[int(np.argmin(costs))]
    return values


@dataclass(frozen=True, kw_only=True, eq=False)
class Progress:
    """Where a run stands, between two plannings: enough to go on.

    Attributes:
        flat, substep, action: of the plant's state.
        values: at the knots.
        series: one row a period so far, (k, m): the numbers that the caller keeps of a sample.
    """

    flat: Array
    substep: int
    action: float
    values: Array
    series: Array


def drive(
    plant: Model,
    oracle: Oracle,
    periods: int,
    measured: Callable[[Sample], Sequence[float]],
    kept: Path,
    origin: State,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Array:
    """Control the plant for so many periods; after every planning the run is kept, and a stopped one goes on.

    Args:
        measured: the numbers to keep of a sample.
        kept: file of a stopped run.
        origin: where the run begins; a kept one goes on with its origin.

    Returns:
        (periods, m), a row a period: of the sample at its start.
    """
    if kept.exists():
        with np.load(kept) as data:
            there = Progress(**{name: data[name] for name in data.files})
        plant.reset(
            State(
                flat=there.flat,
                substep=int(there.substep),
                action=float(there.action),
                origin=origin.origin,
            )
        )
        values, rows = there.values, [tuple(row) for row in there.series]
    else:
        plant.reset(origin)
        values, rows = np.zeros(len(oracle.knots)), list[tuple[float, ...]]()
    sample = plant.reset(plant.state())
    while len(rows) < periods:
        values = oracle.planned(plant, values)
        now = plant.state().action
        for action in oracle.actions(values, now)[: oracle.every]:
            rows.append(tuple(measured(sample)))
            sample = plant.advance(float(action))
        values = oracle.shifted(values, now)
        _keep(kept, plant.state(), values, np.array(rows))
        progress(min(len(rows), periods), periods)
    return np.array(rows[:periods])


def _keep(path: Path, state: State, values: Array, series: Array) -> None:
    there = Progress(flat=state.flat, substep=state.substep, action=state.action, values=values, series=series)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **asdict(there))
