"""The ranking finds the sensors a model depends on, and agrees with Shapley values known exactly."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from contract import sensors
from contract.config.learning import TrainConfig
from train.networks.model import WakeModel
from train.selection.shap_ranking import Ranking, rank, shap_scores


class Linear(nn.Module):
    """z = sum over rows and features of w x: its Shapley values are w (x - mean of the background)."""

    def __init__(self, window: int) -> None:
        super().__init__()
        self.window = window
        generator = torch.Generator().manual_seed(0)
        self.weight = nn.Parameter(torch.randn(3, window, sensors.COUNT + 1, generator=generator))

    def forward(self, windows: Tensor) -> Tensor:
        return torch.einsum("blf,zlf->bz", windows, self.weight)


def draws(background: int, explained: int, samples: int, repeats: int = 1) -> TrainConfig:
    return TrainConfig(shap_background=background, shap_explained=explained, shap_samples=samples, shap_repeats=repeats)


@pytest.mark.slow
def test_scores_of_a_linear_encoder_are_its_shapley_values(rows):
    window, count = 4, 57
    few = replace(rows, inputs=rows.inputs[: count + window - 1], lengths=(count + window - 1,))
    encoder = Linear(window)
    # Every window is explained against every window, so only the choice of points on the paths is random.
    scores = shap_scores(encoder, few, draws(count, count, 300), 0)  # type: ignore[arg-type]
    windows = few.inputs.unfold(0, window, 1).transpose(1, 2)
    exact = encoder.weight.detach()[:, None] * (windows - windows.mean(dim=0))  # (Z, n, L, F)
    expected = exact.abs().sum(dim=0).mean(dim=(0, 1))[: sensors.COUNT].double().numpy()
    np.testing.assert_allclose(scores, expected, rtol=0.03)


def test_only_sensors_the_encoder_listens_to_score(rows, small_config):
    torch.manual_seed(0)
    encoder = WakeModel(90, small_config.model).encoder
    strong, weak = sensors.TRUCK.indices(["base_2", "upper_30"]), sensors.TRUCK.indices(["lower_11"])
    with torch.no_grad():
        weights = encoder.lstm.weight_ih_l0
        assert isinstance(weights, Tensor)
        heard = weights[:, strong].clone()
        weights[:, : sensors.COUNT] = 0.0
        weights[:, strong] = heard
        weights[:, weak] = heard[:, :1] * 0.01
    ranking = rank(encoder, rows, draws(20, 30, 5, repeats=3))
    assert set(ranking.top(2)) == {"base_2", "upper_30"}
    assert ranking.top(3)[2] == "lower_11"
    assert ranking.is_stable(2) and ranking.is_stable(3)
    assert np.count_nonzero(ranking.mean) == 3
    # Sets are compared without their order.
    scores = np.zeros((2, sensors.COUNT))
    scores[0, [3, 5, 7]] = scores[1, [5, 3, 8]] = 10.0, 9.0, 8.0
    ranking = Ranking(scores=scores)
    assert ranking.is_stable(2) and not ranking.is_stable(3)
    np.testing.assert_allclose(ranking.std[[3, 7]], [np.sqrt(0.5), 8 / np.sqrt(2)])


def test_repeats_differ_a_seed_repeats_and_numpy_is_left_alone(rows, small_config):
    encoder = WakeModel(90, small_config.model).encoder
    settings = draws(5, 6, 2, repeats=2)
    np.random.seed(1)
    expected = np.random.rand()
    np.random.seed(1)
    one = rank(encoder, rows, settings)
    assert np.random.rand() == expected
    np.testing.assert_array_equal(one.scores, rank(encoder, rows, settings).scores)
    assert not np.array_equal(one.scores[0], one.scores[1])
    assert all(parameter.requires_grad for parameter in encoder.parameters())


def test_gradients_are_taken_in_training_mode_as_cudnn_requires(rows):
    modes = set[bool]()

    class Watched(Linear):
        def forward(self, windows: Tensor) -> Tensor:
            modes.add(self.training)
            return super().forward(windows)

    encoder = Watched(4).eval()
    shap_scores(encoder, rows, draws(2, 2, 1), 0)  # type: ignore[arg-type]
    assert modes == {True} and not encoder.training
