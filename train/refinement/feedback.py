"""The feedback that becomes the prior of the plan: memory in, next action out, odd in the mirror image.

The memory is reduced by fixed filters: the newest rows each by itself, then means under bumps that widen with age. What
is learned is a layer of tanh units behind them, and how it changes with the vehicle's speed. On the vehicle the
filters stand in front of it as here (`export.program.weights.PriorWeights`), so that a second layer costs little.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from contract.arrays import Array

NEWEST: Final = 10
"""Rows that count each by itself: two convective times."""
BUMPS: Final = 10
"""Means over what is older."""
FIRST_PAIR, OTHER_PAIRS, ACTION = 0.4, 0.15, 0.05
"""Scales of the first pair's difference in Cp, of each other pair's, and of the action: roughly their deviations."""
SPEED_SCALE: Final = 0.4
"""Of the speed less the design speed, in design speeds: how far a vehicle's may be from it."""


def scales_of(pairs: int) -> tuple[float, ...]:
    """A scale for each column of a row: p differences, then the action."""
    return (FIRST_PAIR, *[OTHER_PAIRS] * (pairs - 1), ACTION)


def filters(memory: int) -> Tensor:
    """(M, filters) of weights by row, oldest row first; in a short memory every row counts by itself."""
    age = np.arange(memory)[::-1]
    is_long = memory > NEWEST + BUMPS
    columns = [(age == row).astype(np.float64) for row in range(NEWEST if is_long else memory)]
    if is_long:
        knots = np.geomspace(NEWEST - 1, memory, BUMPS + 2)
        bumps = [np.interp(age, knots[i : i + 3], (0.0, 1.0, 0.0)) for i in range(BUMPS)]
        columns += [bump / bump.sum() for bump in bumps]
    return torch.from_numpy(np.stack(columns, axis=1))


class Feedback(nn.Module):
    """a_{t+1} = limit tanh(output . tanh((first + sigma slope) . filtered rows)), sigma the scaled speed.

    It begins as no control, because `output` is zero, and as one that does not know the speed, because `slope` is.

    Args:
        memory: M, rows (differences, action) that it reads.
        units: of the hidden layer.
        scales: of the columns.
        limit: bound on |a|, in U_inf W.
        seed: of the first weights.
    """

    def __init__(self, memory: int, units: int, scales: tuple[float, ...], limit: float, seed: int) -> None:
        super().__init__()
        self.limit = limit
        self._filters = filters(memory)
        self._scales = torch.tensor(scales, dtype=torch.float64)
        inputs = self._filters.shape[1] * len(scales)
        generator = torch.Generator().manual_seed(seed)
        self.first = nn.Parameter(torch.randn((inputs, units), generator=generator, dtype=torch.float64) / inputs**0.5)
        self.output = nn.Parameter(torch.zeros(units, dtype=torch.float64))
        self.slope = nn.Parameter(torch.zeros_like(self.first.detach()))

    @property
    def memory(self) -> int:
        """M."""
        return len(self._filters)

    @property
    def columns(self) -> int:
        """p + 1."""
        return len(self._scales)

    def forward(self, rows: Tensor, speed: float = 1.0) -> Tensor:
        """The next action from rows (M, p + 1), oldest first, at a speed in design speeds."""
        inputs = (self._filters.T @ (rows / self._scales)).flatten()
        first = self.first + (speed - 1.0) / SPEED_SCALE * self.slope
        action: Tensor = self.limit * torch.tanh(torch.tanh(inputs @ first) @ self.output)
        return action

    def begin_with(self, prior: Mapping[str, Array]) -> None:
        """Take the weights of a prior that was made from such a feedback; of one with other filters, the nearest.

        One that was trained without filters on the vehicle has "hidden" (units, M, p + 1) in place of three tensors.
        """
        theirs = prior.get("filters", np.eye(self.memory))
        first = prior["first"] if "first" in prior else prior["hidden"]
        slope = SPEED_SCALE * prior.get("slope", np.zeros_like(first))
        with torch.no_grad():
            self.output.copy_(torch.from_numpy(prior["output"]))
            for parameter, weights in ((self.first, first), (self.slope, slope)):
                by_row = np.einsum("mf,ufc,c->mcu", theirs, weights, self._scales.numpy()).reshape(self.memory, -1)
                nearest, *_ = np.linalg.lstsq(self._filters.numpy(), by_row, rcond=None)
                parameter.copy_(torch.from_numpy(nearest.reshape(parameter.shape)))

    def as_prior(self) -> dict[str, Array]:
        """What a prior takes of it, with the scales folded in: all tensors but the predictor."""
        size = (self._filters.shape[1], len(self._scales), -1)
        layers = {"first": self.first, "slope": self.slope / SPEED_SCALE, "output": self.output}
        found = {name: layer.detach().numpy() for name, layer in layers.items()}
        for name in ("first", "slope"):
            found[name] = np.moveaxis(found[name].reshape(size), -1, 0) / self._scales.numpy()
        return {"filters": self._filters.numpy(), **found}
