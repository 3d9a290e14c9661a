"""The feedback that becomes the prior of the plan: memory in, next action out, odd in the mirror image.

The memory is reduced by fixed filters: the newest rows each by itself, then means under bumps that widen with age. What
is learned is a layer of tanh units behind them. Filters and layer are one matrix in the controller
(`export.program.weights.PriorWeights`), so that nothing on the vehicle knows of filters.
"""

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
    """a_{t+1} = limit tanh(output . tanh(first . filtered rows)); begins as no control, because `output` is zero.

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

    @property
    def memory(self) -> int:
        """M."""
        return len(self._filters)

    @property
    def columns(self) -> int:
        """p + 1."""
        return len(self._scales)

    def forward(self, rows: Tensor) -> Tensor:
        """The next action from rows (M, p + 1), oldest first."""
        inputs = (self._filters.T @ (rows / self._scales)).flatten()
        action: Tensor = self.limit * torch.tanh(torch.tanh(inputs @ self.first) @ self.output)
        return action

    def begin_with(self, hidden: Array, output: Array) -> None:
        """Take the weights of a prior that was made from such a feedback; of another one, the nearest."""
        by_filter = np.einsum("umc,c->mcu", hidden, self._scales.numpy()).reshape(self.memory, -1)
        first, *_ = np.linalg.lstsq(self._filters.numpy(), by_filter, rcond=None)
        with torch.no_grad():
            self.first.copy_(torch.from_numpy(first.reshape(self.first.shape)))
            self.output.copy_(torch.from_numpy(output))

    def as_prior(self) -> dict[str, Array]:
        """What a prior takes of it: "hidden" (units, M, p + 1) and "output" (units,)."""
        return {"hidden": self.hidden().numpy(), "output": self.output.detach().numpy()}

    def hidden(self) -> Tensor:
        """(units, M, p + 1): filters, scales and the first layer in one."""
        by_filter = self.first.detach().reshape(self._filters.shape[1], len(self._scales), -1)
        return torch.einsum("mf,fcu->umc", self._filters, by_filter) / self._scales
