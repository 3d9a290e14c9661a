"""Shapes, names and residual structure that the export relies on."""

import torch

from contract.config.learning import ModelConfig
from train.networks.model import Encoder, ResidualBlock, WakeModel


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


def test_the_encoder_is_lstm_norm_and_perceptron_of_the_last_state():
    torch.manual_seed(0)
    encoder = Encoder(4, ModelConfig(window=6))
    windows = torch.randn(3, 6, 5)
    last = encoder.lstm(windows)[0][:, -1]
    expected = encoder.output(torch.nn.functional.elu(encoder.hidden(encoder.norm(last))))
    torch.testing.assert_close(encoder(windows), expected, rtol=1e-5, atol=1e-6)
    segments = torch.randn(2, 9, 5)
    shared = encoder.encode_segments(segments)
    for w in range(4):
        torch.testing.assert_close(shared[:, w], encoder(segments[:, w : w + 6]), rtol=1e-5, atol=1e-6)


def test_dynamics_and_blocks_are_residual_and_the_rollout_recurs():
    torch.manual_seed(0)
    model = WakeModel(4, ModelConfig()).eval()
    latent, actions = torch.randn(5, 8), torch.randn(5, 3)
    first, second, third = model.dynamics.rollout(latent, actions)
    torch.testing.assert_close(first, model.dynamics(latent, actions[:, 0]))
    torch.testing.assert_close(third, model.dynamics(second, actions[:, 2]))
    block = model.decoder.blocks[0]
    assert isinstance(block, ResidualBlock)
    with torch.no_grad():
        for parameter in [*model.dynamics.output.parameters(), *block.norm.parameters()]:
            parameter.zero_()
    assert torch.equal(model.dynamics(latent, actions[:, 0]), latent)
    wide = torch.randn(2, 128)
    assert torch.equal(block(wide), wide)


def test_dropout_acts_in_training_only():
    torch.manual_seed(0)
    decoder = WakeModel(4, ModelConfig()).decoder
    latent = torch.randn(5, 8)
    assert not torch.equal(decoder(latent), decoder(latent))
    decoder.eval()
    assert torch.equal(decoder(latent), decoder(latent))
