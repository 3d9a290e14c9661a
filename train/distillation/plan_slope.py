"""How the controller's cost falls off along a plan: what the optimiser reads from dynamics and decoder (ours).

Shapes: B plans of H actions, N_z latent dimensions. Latents, actions and forces are standardised.
"""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from contract.config.controller import CostWeights
from contract.release.manifest import Scaling
from train.networks.model import Decoder, Dynamics


class Predicts(Protocol):
    """Dynamics and decoder: `train.networks.model.Predictor` or `WakeModel`."""

    dynamics: Dynamics
    decoder: Decoder


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """A roll-out and its forces.

    Attributes:
        latents: (H + 1, B, N_z) at t .. t+H.
        forces: (H + 1, B, 2) at t .. t+H.
    """

    latents: Tensor
    forces: Tensor


def predict(model: Predicts, latent: Tensor, actions: Tensor) -> Prediction:
    """From (B, N_z) latents at t under (B, H) actions at t .. t+H-1."""
    latents = torch.cat([latent[None], model.dynamics.rollout(latent, actions)])
    return Prediction(latents=latents, forces=model.decoder(latents))


def force_slope(forces: Tensor, weights: CostWeights, scaling: Scaling) -> Tensor:
    """Derivatives of the cost's terms in the forces (paper, equations 12-15), (H, B, 2), by standardised forces.
    `forces` are (H, B, 2) at t+1 .. t+H, standardised."""
    mean, deviation = (forces.new_tensor(values) for values in (scaling.force_mean, scaling.force_std))
    with torch.enable_grad():
        leaf = forces.detach().requires_grad_(True)
        drag, lift = (leaf * deviation + mean).unbind(-1)
        cost = (
            weights.drag_mean * drag.mean(0)
            + weights.drag_fluctuation * (drag.amax(0) - drag.amin(0))
            + weights.lift * lift.abs().mean(0)
            + weights.lift_mean * lift.mean(0).square()
        )
        (slope,) = torch.autograd.grad(cost.sum(), leaf)
    return slope


def plan_slope(prediction: Prediction, actions: Tensor, by_force: Tensor, *, differentiable: bool = False) -> Tensor:
    """(B, H) slope of a cost along the plan, given its slope by the forces (H, B, 2) at t+1 .. t+H.

    Args:
        prediction: of the actions, which it was recorded with.
        differentiable: whether the slope itself is to be differentiated, by the networks' weights.
    """
    (slope,) = torch.autograd.grad(
        prediction.forces[1:], actions, by_force, create_graph=differentiable, retain_graph=True
    )
    return slope
