"""Each term of the loss against numbers worked out by hand or from its formula; the shared recurrence is torch's
LSTM, window by window."""

import math

import numpy as np
import pytest
import torch
from torch import nn

from contract.config.learning import ModelConfig, TrainConfig
from train.networks.model import EPSILON, WakeModel, covariance_loss, joint_loss, prediction_loss, variance_loss
from train.networks.recurrence import last_hidden
from train.networks.samples import Batch


def test_terms_by_hand_and_by_formula():
    predicted = torch.tensor([[[1.0, 2.0]], [[0.0, 0.0]]])
    target = torch.tensor([[[0.0, 0.0]], [[3.0, 0.0]]])
    assert prediction_loss(predicted, target).item() == pytest.approx((1 + 4 + 9) / 4)
    # Variance loss by hand.
    latents = torch.tensor([[0.0, 0.0], [1.0, 10.0]])  # variances 1/2 and 50
    assert variance_loss(latents).item() == pytest.approx((1 - math.sqrt(0.5 + EPSILON)) / 2, rel=1e-6)
    assert variance_loss(torch.zeros(4, 3)).item() == pytest.approx(1 - math.sqrt(EPSILON), rel=1e-6)
    # Covariance loss against the formula.
    drawn = np.random.default_rng(0).normal(size=(3, 20, 4))
    expected = 0.0
    for batch in drawn:
        covariance = np.cov(batch.T)
        expected += sum(covariance[i, j] ** 2 for i in range(4) for j in range(4) if i != j) / (4 * 3)
    assert covariance_loss(torch.from_numpy(drawn)).item() == pytest.approx(expected / 3, rel=1e-12)
    assert covariance_loss(torch.randn(5, 1)).item() == 0.0


def test_joint_loss_against_a_sample_by_sample_unroll():
    torch.manual_seed(0)
    segment, steps, window, segments = 3, 2, 4, 5
    settings = TrainConfig(
        unroll=steps, force_weight=0.3, decode_weight=0.6, variance_weight=0.7, covariance_weight=0.4
    )
    config = ModelConfig(window=window, latent=3, lstm_width=5, dynamics_width=6, decoder_width=7, dropout=0.0)
    model = WakeModel(6, config)
    ends = segment + steps
    batch = Batch(
        inputs=torch.randn(segments, ends + window - 1, 7),
        actions=torch.randn(segments, ends),
        forces=2 * torch.randn(segments, ends, 2),
        ends=torch.zeros(segments, ends, dtype=torch.long),
    )
    terms = joint_loss(model, batch, settings)

    def encode(row: torch.Tensor, end: int) -> torch.Tensor:
        return model.encoder(row[None, end : end + window])[0]

    def smooth_l1(z: torch.Tensor, forces: torch.Tensor) -> torch.Tensor:
        error = (model.decoder(z) - forces).abs()
        return torch.where(error < 1, 0.5 * error**2, error - 0.5).mean()

    squares, forces, decoded = [], [], []
    latents: list[list[torch.Tensor]] = [[] for _ in range(steps)]
    for s in range(segments):
        decoded += [smooth_l1(encode(batch.inputs[s], end), batch.forces[s, end]) for end in range(ends)]
        for j in range(segment):
            z = encode(batch.inputs[s], j)
            for i in range(1, steps + 1):
                z = model.dynamics(z, batch.actions[s, j + i - 1])
                squares.append((z - encode(batch.inputs[s], j + i)).square().mean())
                forces.append(smooth_l1(z, batch.forces[s, j + i]))
                latents[i - 1].append(z)
    stacked = [torch.stack(step) for step in latents]
    prediction, force, decode = (torch.stack(values).mean() for values in (squares, forces, decoded))
    variance = torch.stack([variance_loss(z) for z in stacked]).mean()
    covariance = torch.stack([covariance_loss(z) for z in stacked]).mean()
    expected = {"prediction": prediction, "force": force, "decode": decode}
    expected |= {"variance": variance, "covariance": covariance}
    expected["total"] = prediction + 0.3 * force + 0.6 * decode + 0.7 * variance + 0.4 * covariance
    for name, value in terms.items():
        torch.testing.assert_close(value, expected[name], rtol=1e-5, atol=1e-6)
    parameters = list(model.parameters())
    found = torch.autograd.grad(terms["total"], parameters, retain_graph=True)
    for gradient, wanted in zip(found, torch.autograd.grad(expected["total"], parameters), strict=True):
        torch.testing.assert_close(gradient, wanted, rtol=1e-4, atol=1e-5)


WINDOW, FEATURES, WIDTH = 7, 5, 6


@pytest.fixture
def lstm() -> nn.LSTM:
    torch.manual_seed(0)
    return nn.LSTM(FEATURES, WIDTH, batch_first=True).double()


def one_by_one(lstm: nn.LSTM, segments: torch.Tensor) -> torch.Tensor:
    rows = segments.shape[1]
    finals = [lstm(segments[:, k : k + WINDOW])[0][:, -1] for k in range(rows - WINDOW + 1)]
    return torch.stack(finals, dim=1)


def test_values_and_gradients_are_those_of_nn_lstm(lstm):
    for count, rows in ((1, WINDOW), (4, WINDOW), (1, 20), (3, 12)):
        segments = torch.randn(count, rows, FEATURES, dtype=torch.float64, requires_grad=True)
        shared = last_hidden(segments, WINDOW, *lstm.all_weights[0])
        expected = one_by_one(lstm, segments)
        torch.testing.assert_close(shared, expected, rtol=1e-12, atol=1e-12)
        with torch.no_grad():
            plain = last_hidden(segments, WINDOW, *lstm.all_weights[0])
        assert not plain.requires_grad
        torch.testing.assert_close(plain, shared.detach(), rtol=0, atol=0)
        direction = torch.randn_like(expected)
        wanted = [segments, *lstm.parameters()]
        gradients = torch.autograd.grad(shared, wanted, direction)
        for gradient, true in zip(gradients, torch.autograd.grad(expected, wanted, direction), strict=True):
            torch.testing.assert_close(gradient, true, rtol=1e-10, atol=1e-12)
    # Gradient of the input alone.
    segments = torch.randn(2, 9, FEATURES, dtype=torch.float64, requires_grad=True)
    lstm.requires_grad_(False)
    (found,) = torch.autograd.grad(last_hidden(segments, WINDOW, *lstm.all_weights[0]).sum(), segments)
    (true,) = torch.autograd.grad(one_by_one(lstm, segments).sum(), segments)
    torch.testing.assert_close(found, true, rtol=1e-10, atol=1e-12)
