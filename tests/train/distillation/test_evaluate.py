"""Held-out figures against direct formulas on networks whose answers are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from contract.errors import DatasetError
from train.distillation.evaluate import evaluate
from train.networks.samples import Rows

WINDOW = 4


class LastRow(nn.Module):
    """Latents are the window's last row plus a bias."""

    def __init__(self, bias: float) -> None:
        super().__init__()
        self.window, self.bias = WINDOW, bias
        self.output = nn.Linear(1, 2)

    def encode_segments(self, segments: Tensor) -> Tensor:
        return segments[:, WINDOW - 1 :, :2] + self.bias


class Add(nn.Module):
    """z' = z + a in both dimensions."""

    def rollout(self, latent: Tensor, actions: Tensor) -> Tensor:
        return torch.stack([latent + total[:, None] for total in actions.cumsum(dim=1).T])


def make_rows(lengths: tuple[int, ...]) -> Rows:
    """Forces equal the rows' first two columns, which are the running sum of the actions."""
    generator = torch.Generator().manual_seed(0)
    actions = torch.randn(sum(lengths), generator=generator)
    walk = torch.cat([torch.tensor([0.0]), actions.cumsum(0)[:-1]])
    forces = torch.stack([walk, walk], dim=1)
    inputs = torch.cat([forces, actions[:, None]], dim=1)
    return Rows(inputs=inputs, actions=actions, forces=forces, lengths=lengths, unit=torch.ones(2))


def run(rows: Rows, bias: float = 0.0, horizons: tuple[int, ...] = (2, 5)):
    return evaluate(LastRow(bias), SimpleNamespace(dynamics=Add(), decoder=nn.Identity()), rows, horizons=horizons)  # type: ignore[arg-type]


def test_errors_are_those_of_the_formula():
    for item in run(make_rows((40, 30))).rollout:
        assert max(item.latent, item.drag, item.lift) < 1e-5
    rows, bias = make_rows((40, 30)), 0.3
    metrics = run(rows, bias)
    seen = np.concatenate([rows.forces[WINDOW - 1 : 40, 0], rows.forces[40 + WINDOW - 1 :, 0]]).astype(float)
    assert metrics.drag.r2 == pytest.approx(1 - bias**2 / seen.var(), rel=1e-5)
    assert metrics.drag.l1_over_sigma == pytest.approx(bias / seen.std(), rel=1e-5)
    for item in metrics.rollout:
        # The offset is carried along; against the encoder's own later latents it cancels.
        assert item.lift == pytest.approx(bias / seen.std(), rel=1e-4)
        assert item.latent == pytest.approx(0.0, abs=1e-5)
    assert [item.horizon for item in metrics.rollout] == [2, 5]


def test_short_and_constant_test_episodes_are_refused():
    with pytest.raises(DatasetError, match="a window of 4 and 5 steps ahead"):
        run(make_rows((8, 8)))
    rows = make_rows((40,))
    with pytest.raises(DatasetError, match="constant"):
        run(replace(rows, forces=torch.zeros(40, 2)))
