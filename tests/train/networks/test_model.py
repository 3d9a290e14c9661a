"""Shapes, names and residual structure that the export relies on."""

import torch

from contract.config.learning import ModelConfig
from train.networks.model import WakeModel


def test_names_and_shapes_of_the_weights_are_the_paper_s():
    shapes = {key: tuple(value.shape) for key, value in WakeModel(90, ModelConfig()).state_dict().items()}
    norm = {64: ("encoder.norm",), 256: ("dynamics.norm_in", "dynamics.norm_hidden")}
    expected = {
        "encoder.lstm.weight_ih_l0": (256, 91),
        "encoder.lstm.weight_hh_l0": (256, 64),
        "encoder.lstm.bias_ih_l0": (256,),
        "encoder.lstm.bias_hh_l0": (256,),
    }
    norm[128] = ("decoder.blocks.0.norm", "decoder.blocks.1.norm")
    linear = {
        "encoder.hidden": (64, 64),
        "encoder.output": (8, 64),
        "dynamics.input": (256, 9),
        "dynamics.hidden": (256, 256),
        "dynamics.output": (8, 256),
        "decoder.input": (128, 8),
        "decoder.blocks.0.linear": (128, 128),
        "decoder.blocks.1.linear": (128, 128),
        "decoder.output": (2, 128),
    }
    for width, names in norm.items():
        for name in names:
            expected |= {f"{name}.weight": (width,), f"{name}.bias": (width,)}
    for name, shape in linear.items():
        expected |= {f"{name}.weight": shape, f"{name}.bias": shape[:1]}
    assert shapes == expected


def test_dropout_acts_in_training_only():
    torch.manual_seed(0)
    decoder = WakeModel(4, ModelConfig()).decoder
    latent = torch.randn(5, 8)
    assert not torch.equal(decoder(latent), decoder(latent))
    decoder.eval()
    assert torch.equal(decoder(latent), decoder(latent))
