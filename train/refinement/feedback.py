"""The feedback controller that becomes the prior of the plan. It computes the next action from a memory of rows. A row
has the differences and the sums of the sensor pairs, and the action. Fixed filters reduce the memory: the newest rows
are used one by one, older rows as weighted means, whose triangular weights widen with age. The trained part is a layer
of tanh units on the filtered differences and actions, scheduled by the vehicle's speed, the goal
(`contract.controller.goal`) and the filtered sums. The vehicle's program applies the same filters
(`export.program.weights.PriorWeights`).
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from contract.arrays import Array
from contract.controller.goal import OWN, SCHEDULED, SPEED_PLACES, SPEED_SCALE, Goal, of_two_speeds, schedule

NEWEST: Final = 10
"""Number of newest rows that are used one by one: two convective times."""
BUMPS: Final = 10
"""Number of weighted means of older rows."""
FIRST_PAIR, OTHER_PAIRS = 1.7, 0.56
"""Scales of the Cp differences, for the first pair and the others, in standard deviations of the recorded Cp."""
ACTION: Final = 2.0 / 3.0
"""Scale of the action, as a fraction of the action limit."""
SUM: Final = 0.3
"""Scale of a pair's sum in Cp, after its mean is subtracted. The sums of the developed and the steady wake
differ by 0.4, for the truck and also for a square cylinder."""


def scales_of(deviations: Sequence[float], limit: float) -> tuple[float, ...]:
    """Return a scale for each column of a row: p differences, then the action. `deviations` (p,) are those of the
    recorded Cp at one sensor of each pair; `limit` is the bound on |a|."""
    first, *others = deviations
    return (FIRST_PAIR * first, *(OTHER_PAIRS * one for one in others), ACTION * limit)


def filters(memory: int) -> Tensor:
    """Return the filter weights, (M rows, number of filters), oldest row first."""
    age = np.arange(memory)[::-1]
    is_long = memory > NEWEST + BUMPS
    columns = [(age == row).astype(np.float64) for row in range(NEWEST if is_long else memory)]
    if is_long:
        knots = np.geomspace(NEWEST - 1, memory, BUMPS + 2)
        bumps = [np.interp(age, knots[i : i + 3], (0.0, 1.0, 0.0)) for i in range(BUMPS)]
        columns += [bump / bump.sum() for bump in bumps]
    return torch.from_numpy(np.stack(columns, axis=1))


class Feedback(nn.Module):
    """A feedback a_{t+1} = (1 - limit / 2) A tanh(output . (1 + tanh(gate . (s, sums))) tanh((first . s) . rows)).

    A is the release's action limit. s = (1, slower, faster, effort, lift, limit) are the scheduling inputs of
    `contract.controller.goal`; effort, lift and limit are the parts of the goal, each from 0 to 1. `rows` are the
    filtered differences and actions, `sums` the filtered sums of the pairs. In the mirror image, only the rows change
    their sign, so the action has exactly the opposite sign. Initially, `output` is zero, so all actions are zero, and
    the layer does not depend on s.

    Args:
        memory: M, number of rows (differences, sums, action) that the feedback reads.
        units: number of units of the hidden layer.
        scales: scales of the p differences and the action.
        middles: (p,) means of the sums, in Cp.
        limit: A, bound on |a|, in U_inf W.
    """

    def __init__(
        self, memory: int, units: int, scales: tuple[float, ...], middles: tuple[float, ...], limit: float, seed: int
    ) -> None:
        super().__init__()
        self.limit = limit
        self._filters = filters(memory)
        self._scales = torch.tensor(scales, dtype=torch.float64)
        self.middles = torch.tensor(middles, dtype=torch.float64)
        count = self._filters.shape[1]
        inputs, gates = count * len(scales), len(SCHEDULED) + count * len(middles)
        generator = torch.Generator().manual_seed(seed)
        first = torch.zeros((len(SCHEDULED), inputs, units), dtype=torch.float64)
        first[0] = torch.randn((inputs, units), generator=generator, dtype=torch.float64) / inputs**0.5
        self.first = nn.Parameter(first)
        self.gate = nn.Parameter(torch.zeros((gates, units), dtype=torch.float64))
        self.output = nn.Parameter(torch.zeros(units, dtype=torch.float64))

    @property
    def memory(self) -> int:
        """M, the number of rows that the feedback reads."""
        return len(self._filters)

    @property
    def pairs(self) -> int:
        """p, the number of sensor pairs."""
        return len(self.middles)

    def forward(self, rows: Tensor, speed: float = 1.0, goal: Goal = OWN) -> Tensor:
        """Compute the next action from rows (M, 2 p + 1), oldest first; the speed is in units of the design speed."""
        odd, even = self.features(rows)
        scheduled = torch.tensor(schedule(speed, goal), dtype=torch.float64)
        first = torch.einsum("s,siu->iu", scheduled, self.first)
        units = torch.tanh(odd @ first)
        gates = 1.0 + torch.tanh(torch.cat([scheduled, even]) @ self.gate)
        action: Tensor = goal.share_of_limit() * self.limit * torch.tanh((gates * units) @ self.output)
        return action

    def features(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Filter and scale rows (..., M, 2 p + 1). Returns differences with actions, and sums, each (..., inputs)."""
        pairs = self.pairs
        odd = torch.cat([rows[..., :pairs], rows[..., -1:]], dim=-1) / self._scales
        even = (rows[..., pairs:-1] - self.middles) / SUM
        return (self._filters.T @ odd).flatten(-2), (self._filters.T @ even).flatten(-2)

    def begin_with(self, prior: Mapping[str, Array]) -> None:
        """Load the weights of a prior from `as_prior`, or from release 1.0.0, whose prior has no inputs for goal and
        sums. If the prior has fewer units, the remaining units stay unchanged."""
        units, pairs, count = len(prior["output"]), self.pairs, self._filters.shape[1]
        first, gate, sums = of_two_speeds(prior["first"]), prior.get("gate"), prior.get("sums")
        if "slope" in prior:
            first = np.zeros((len(SCHEDULED), *prior["slope"].shape))
            first[0], first[list(SPEED_PLACES)] = prior["first"], SPEED_SCALE * prior["slope"]
        gate = np.zeros((units, len(SCHEDULED))) if gate is None else of_two_speeds(gate.T).T.copy()
        sums = np.zeros((units, count, pairs)) if sums is None else sums
        by_sum = sums.reshape(units, -1)
        gate[:, 0] += by_sum @ np.tile(self.middles.numpy(), count)
        with torch.no_grad():
            self.output[:units] = torch.from_numpy(prior["output"])
            flat = np.moveaxis(first * self._scales.numpy(), 1, -1).reshape(len(SCHEDULED), -1, units)
            self.first[:, :, :units] = torch.from_numpy(flat)
            self.gate[:, :units] = torch.from_numpy(np.hstack([gate, SUM * by_sum]).T.copy())

    def as_prior(self) -> dict[str, Array]:
        """Return this feedback as a prior's tensors without the predictor, for rows that are not scaled or centred."""
        count, scheduled = self._filters.shape[1], len(SCHEDULED)
        first, gate = self.first.detach().numpy(), self.gate.detach().numpy()
        by_unit = np.moveaxis(first.reshape(scheduled, count, len(self._scales), -1), -1, 1)
        by_sum = gate[scheduled:] / SUM
        alone = gate[:scheduled].copy()
        alone[0] -= np.tile(self.middles.numpy(), count) @ by_sum
        return {
            "filters": self._filters.numpy(),
            "first": by_unit / self._scales.numpy(),
            "gate": alone.T.copy(),
            "sums": np.moveaxis(by_sum.reshape(count, self.pairs, -1), -1, 0).copy(),
            "output": self.output.detach().numpy(),
        }
