"""The shared recurrence is torch's LSTM, window by window."""

import pytest
import torch
from torch import nn

from train.networks.recurrence import last_hidden

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
