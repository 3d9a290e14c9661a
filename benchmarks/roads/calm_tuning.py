"""The release's networks, tuned end to end on recordings that hold the steady wake.

Encoder, dynamics and decoder of the vehicle learn together from the four sensors, on the joint loss of the training
(`train.networks.loss`), with what the training has not: every window weighs by 1 / (0.1 + mean |Cl| of the steps that
are predicted from it), in deviations of Cl, so that shedding does not drown small signals.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from contract.model.model_folder import SLIM, Tensors
from contract.recording.dataset import Episode
from train.model_store import TrainedModel
from train.networks.loss import covariance_loss, variance_loss
from train.networks.model import WakeModel
from train.samples.rows import prepare
from train.samples.sampler import Batch, SegmentSampler

SMALLEST: Final = 0.1
"""Deviations of Cl, below which windows weigh alike."""


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """How long and how fast: iterations of 512 samples, Adam over one cycle."""

    steps: int = 600
    unroll: int = 25
    learning_rate: float = 1e-3
    segment: int = 32
    batch_size: int = 512
    force_weight: float = 2.0
    decode_weight: float = 2.0
    variance_weight: float = 0.02


def weights_of(forces: Tensor) -> Tensor:
    """Weights (B,) of windows whose next h steps have these scaled forces, (h, B, 2); their mean is 1."""
    weight = 1.0 / (SMALLEST + forces[..., 1].abs().mean(dim=0))
    return weight / weight.mean()


def tuning_loss(model: WakeModel, batch: Batch, tuning: Tuning) -> Tensor:
    """The loss of a batch whose segments hold W - k samples of k = `tuning.unroll` steps each."""
    steps = tuning.unroll
    encoded = model.encoder.encode_segments(batch.inputs)
    samples = encoded.shape[1] - steps
    start = encoded[:, :samples].flatten(0, 1)
    predicted = model.dynamics.rollout(start, batch.actions.unfold(1, steps, 1)[:, :samples].flatten(0, 1))
    target = torch.stack([encoded[:, i : i + samples].flatten(0, 1) for i in range(1, steps + 1)])
    forces = torch.stack([batch.forces[:, i : i + samples].flatten(0, 1) for i in range(1, steps + 1)])
    now = batch.forces[:, :samples].flatten(0, 1)
    prediction = (predicted - target).square().mean(dim=(0, 2))
    force = _huber(model.decoder(predicted), forces).mean(dim=(0, 2))
    decode = _huber(model.decoder(start), now).mean(dim=1)
    each = prediction + tuning.force_weight * force + tuning.decode_weight * decode
    spread = variance_loss(predicted) + covariance_loss(predicted)
    return (weights_of(forces) * each).mean() + tuning.variance_weight * spread


def tune(model: TrainedModel, episodes: Sequence[Episode], tuning: Tuning, iterations: Iterable[int]) -> Tensors:
    """The tuned networks of the vehicle under their names in a model folder; the model's own are changed in place.

    Args:
        model: with a predictor of its own; its scaling stays.
        episodes: of the model's sensors; their mirror images are learned from, too.
        iterations: 0 .. tuning.steps - 1, with progress where it is wanted.
    """
    assert model.predictor is not None
    chosen = model.layout.indices(model.sensors)
    rows = prepare(episodes, model.scaling, mirrored=True, layout=model.layout).with_sensors(chosen)
    sampler = SegmentSampler(
        rows,
        window=model.config.model.window,
        ahead=tuning.unroll,
        segment=tuning.segment,
        batch_size=tuning.batch_size,
        seed=0,
    )
    deployed = WakeModel(len(chosen), model.config.model.slim)
    deployed.encoder, deployed.dynamics, deployed.decoder = (
        model.slim,
        model.predictor.dynamics,
        model.predictor.decoder,
    )
    deployed.train()
    optimiser = torch.optim.Adam(deployed.parameters(), lr=tuning.learning_rate)
    cycle = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, max_lr=tuning.learning_rate, total_steps=tuning.steps, pct_start=0.15
    )
    for step in iterations:
        loss = tuning_loss(deployed, sampler.batch(step), tuning)
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(deployed.parameters(), 1.0)
        optimiser.step()
        cycle.step()
    deployed.eval()
    parts = {SLIM: deployed.encoder, f"{SLIM}_dynamics": deployed.dynamics, f"{SLIM}_decoder": deployed.decoder}
    return {
        f"{name}.{key}": np.asarray(value.detach())
        for name, network in parts.items()
        for key, value in network.state_dict().items()
    }


def _huber(found: Tensor, wanted: Tensor) -> Tensor:
    return nn.functional.smooth_l1_loss(found, wanted, reduction="none", beta=0.3)
