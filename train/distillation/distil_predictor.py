"""Narrower dynamics and decoder for small ECUs, distilled on roll-outs of the trained networks (this project's method).

The paper slims only the encoder, but nearly all computation of a control step is in the other two networks: the
optimiser rolls them out over `horizon` steps, forwards and backwards, in every iteration. So the student learns from
whole roll-outs of that length, which begin with latents of the vehicle's encoder, and also learns the gradient of the
cost with respect to the plan, the only result that the optimiser uses (Sobolev training, Czarnecki et al. 2017).
"""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from contract.config.learning import ModelConfig, TrainConfig
from train.distillation.lessons import Lessons, plan_slope, predict
from train.fitting.checkpoint import Checkpoints
from train.fitting.fit import optimise, seeded
from train.fitting.progress import Phase, Progress, silent
from train.networks.loss import prediction_loss
from train.networks.model import Predictor

_FEWER = 4
"""Ratio of the windows' batch size to the roll-outs' batch size. It is above 1, because each roll-out has H
predictions."""


def distil_predictor(
    lessons: Lessons,
    model: ModelConfig,
    settings: TrainConfig,
    *,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> Predictor:
    """Train dynamics and decoder of the slim widths to reproduce the teacher's roll-outs.

    The loss is the sum of three terms. The first is the mean square of the latents' difference over h = 1 .. H, the
    second the forces' Smooth L1 over h = 0 .. H; latents and forces are in standard deviations. The third is
    `slope_weight` times the mean square of the difference between the student's and the teacher's gradients of the
    cost, divided by the mean square of the teacher's gradient. Returns the student in evaluation mode, with the slim
    widths of `model`, on the lessons' device.
    """
    device = lessons.actions.device
    batch_size = max(2, settings.batch_size // _FEWER)
    steps = max(1, round(settings.predictor_epochs * len(lessons) / batch_size))
    with seeded(settings.seed, device):
        student = Predictor(model.slim).to(device)

        def loss(step: int) -> Mapping[str, Tensor]:
            generator = np.random.default_rng((settings.seed, step))
            drawn = torch.as_tensor(generator.integers(len(lessons), size=batch_size), device=device)
            lesson = lessons.drawn(drawn)
            latents, forces, by_force = (
                value.transpose(0, 1) for value in (lesson.latents, lesson.forces, lesson.by_force)
            )
            actions = lesson.actions.requires_grad_(True)
            predicted = predict(student, latents[0], actions)
            terms = {
                "prediction": prediction_loss(predicted.latents[1:], latents[1:]),
                "force": nn.functional.smooth_l1_loss(predicted.forces, forces),
            }
            total = terms["prediction"] + terms["force"]
            if settings.slope_weight:
                slope = plan_slope(predicted, actions, by_force, differentiable=True)
                terms["slope"] = (slope - lesson.slope).square().mean() / lesson.slope.square().mean()
                total = total + settings.slope_weight * terms["slope"]
            return {"total": total, **terms}

        optimise(student, loss, steps, settings, phase=Phase.PREDICTOR, progress=progress, checkpoints=checkpoints)
    return student
