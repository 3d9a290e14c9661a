"""The joint loss (paper, equation 5) and its terms.

    L = L_pred + lambda_force L_force + lambda_var L_var + lambda_cov L_cov [+ lambda_decode L_decode, ours]

The dynamics are unrolled k steps from the encoded z_t to predict latents. The targets are the encoder's own latents at
t+1 .. t+k; gradients flow through targets and predictions, so the encoder learns a predictable state. The VICReg terms
act on the predictions and prevent a collapse of the latents.

The paper has no L_decode. This term is L_force at h = 0, for the encoded latent. Without this term, an unroll of 20
steps would train the decoder mostly on latents with the accumulated errors of many steps.
"""

import torch
from torch import Tensor, nn

from contract.config.learning import TrainConfig
from train.networks.model import WakeModel
from train.samples.sampler import Batch

EPSILON = 1e-4
"""Constant inside the square root of the variance term. VICReg's authors use 1e-4; the paper states only "small"."""


def joint_loss(model: WakeModel, batch: Batch, config: TrainConfig) -> dict[str, Tensor]:
    """Compute the loss of a batch. A segment of W windows has W - k samples, with k = `config.unroll` steps each.
    Returns scalars by name: the weighted sum "total", and the terms without weights."""
    steps = config.unroll
    encode = model.encoder.encode_stream if config.streamed else model.encoder.encode_segments
    encoded = encode(batch.inputs)
    samples = encoded.shape[1] - steps
    start = encoded[:, :samples].flatten(0, 1)
    actions = batch.actions.unfold(1, steps, 1)[:, :samples].flatten(0, 1)
    predicted = model.dynamics.rollout(start, actions)
    target = torch.stack([encoded[:, i : i + samples].flatten(0, 1) for i in range(1, steps + 1)])
    forces = torch.stack([batch.forces[:, i : i + samples].flatten(0, 1) for i in range(1, steps + 1)])
    prediction = prediction_loss(predicted, target)
    force = nn.functional.smooth_l1_loss(model.decoder(predicted), forces)
    decode = nn.functional.smooth_l1_loss(model.decoder(encoded), batch.forces)
    variance, covariance = variance_loss(predicted), covariance_loss(predicted)
    total = (
        prediction
        + config.force_weight * force
        + config.decode_weight * decode
        + config.variance_weight * variance
        + config.covariance_weight * covariance
    )
    return {
        "total": total,
        "prediction": prediction,
        "force": force,
        "decode": decode,
        "variance": variance,
        "covariance": covariance,
    }


def prediction_loss(predicted: Tensor, target: Tensor) -> Tensor:
    """Compute the mean square error over samples, steps and dimensions of latents (..., N_z). The paper has the squared
    L2 norm, a sum over the N_z = 8 dimensions. With a variance weight of 0.02, this sum collapses the latent space of a
    test oscillator. With the mean, equally many steps give a fit with R2 = 0.99."""
    return (predicted - target).square().mean()


def variance_loss(latents: Tensor) -> Tensor:
    """Compute the mean of max(0, 1 - sqrt(Var + epsilon)) for latents (..., B, D), over dimensions and leading axes."""
    deviation = (latents.var(dim=-2) + EPSILON).sqrt()
    return nn.functional.relu(1.0 - deviation).mean()


def covariance_loss(latents: Tensor) -> Tensor:
    """Compute the mean square of the off-diagonal covariances of latents (..., B, D), also over leading axes."""
    count, dimension = latents.shape[-2:]
    if dimension == 1:
        return latents.new_zeros(())
    centred = latents - latents.mean(dim=-2, keepdim=True)
    covariance = centred.transpose(-1, -2) @ centred / (count - 1)
    squares = covariance.square()
    off_diagonal = squares.sum(dim=(-2, -1)) - squares.diagonal(dim1=-2, dim2=-1).sum(dim=-1)
    return (off_diagonal / (dimension * (dimension - 1))).mean()
