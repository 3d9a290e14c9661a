"""Rows whose columns are independent, and a teacher that listens to a few of them."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from contract import sensors
from train.networks.samples import Rows

WINDOW = 32
MakeRows = Callable[..., Rows]


class Listener(nn.Module):
    """Latents are weighted sums of some columns at some ages: z = sum of w x, over (column, age, w) of each latent."""

    def __init__(self, *latents: tuple[tuple[str, int, float], ...]) -> None:
        super().__init__()
        self.window = WINDOW
        self.weight = torch.zeros(len(latents), WINDOW, sensors.COUNT + 1)
        for number, terms in enumerate(latents):
            for name, age, weight in terms:
                column = sensors.COUNT if name == "action" else sensors.NAMES.index(name)
                self.weight[number, WINDOW - 1 - age, column] = weight

    def encode_segments(self, segments: Tensor) -> Tensor:
        windows = segments.unfold(1, WINDOW, 1)  # (S, W, F, L)
        return torch.einsum("swfl,zlf->swz", windows, self.weight)


@pytest.fixture(scope="session")
def listener() -> type[Listener]:
    """Build a teacher: `listener(*latents)`."""
    return Listener


@pytest.fixture(scope="session")
def noise_rows() -> MakeRows:
    """Build rows of white noise of unit variance in all columns: `noise_rows(lengths)`."""

    def make(lengths: tuple[int, ...]) -> Rows:
        total = sum(lengths)
        inputs = torch.randn(total, sensors.COUNT + 1, generator=torch.Generator().manual_seed(0))
        return Rows(inputs=inputs, actions=torch.zeros(total), forces=torch.zeros(total, 2), lengths=lengths)

    return make
