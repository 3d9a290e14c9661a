"""Shapes, names and residual structure that the export relies on."""

import torch

from contract.config.learning import ModelConfig
from train.networks.model import WakeModel


def test_names_and_shapes_of_the_weights_are_the_paper_s():
    shapes = {key: tuple(value.shape) for key, value in WakeModel(90, ModelConfig()).state_dict().items()}
    assert {name: shape for name, shape in shapes.items() if len(shape) == 2} == {
        "encoder.lstm.weight_ih_l0": (256, 91),
        "encoder.lstm.weight_hh_l0": (256, 64),
        "encoder.hidden.weight": (64, 64),
        "encoder.output.weight": (8, 64),
        "dynamics.input.weight": (256, 9),
        "dynamics.hidden.weight": (256, 256),
        "dynamics.output.weight": (8, 256),
        "decoder.input.weight": (128, 8),
        "decoder.blocks.0.linear.weight": (128, 128),
        "decoder.blocks.1.linear.weight": (128, 128),
        "decoder.output.weight": (2, 128),
    }


def test_dropout_acts_in_training_only():
    torch.manual_seed(0)
    decoder = WakeModel(4, ModelConfig()).decoder
    latent = torch.randn(5, 8)
    assert not torch.equal(decoder(latent), decoder(latent))
    decoder.eval()
    assert torch.equal(decoder(latent), decoder(latent))
