"""The slim encoder: few sensors, the teacher's latents (paper, section 2.3.2).

    L_distil = 1/(B N_z) sum || z_target - z_slim ||^2

The mean over the latent dimensions, as in the joint loss (`train.networks.loss.prediction_loss`), is a constant factor
that Adam undoes. The teacher is frozen, so its latents of every window are computed once.

Narrower dynamics and decoder for small ECUs are distilled from the trained ones on roll-outs (ours). The paper slims
the encoder alone. Nearly all work of a control step is in the other two networks, which the optimiser rolls out
`horizon` steps ahead, forth and back, in every iteration. So the student is trained as it will serve: on whole
roll-outs of that length, in which the small errors of single steps add up, from the latents of the encoder that it will
serve with, and on the slope of the cost along the plan, which is all that the optimiser takes from it (Czarnecki et al.
2017 call that Sobolev training).
"""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from contract.arrays import Index
from contract.config.learning import ModelConfig, TrainConfig
from contract.config.tree import Config
from train.distillation.lessons import Lessons, plan_slope, predict
from train.fitting.fit import Checkpoints, Schedule, optimise, seeded
from train.fitting.progress import Phase, Progress, silent
from train.fitting.streaming import fit_stream
from train.networks.loss import prediction_loss
from train.networks.model import Encoder, Predictor
from train.samples.rows import Rows
from train.samples.sampler import SegmentSampler, add_sensor_noise

_CHUNK = 1024
"""Windows encoded at a time: their gates stay in the processor's cache."""


def encode_all(encoder: Encoder, rows: Rows) -> Tensor:
    """Latents of every full window, (n, N_z), one for each row; NaN where an episode has no L rows yet."""
    window = encoder.window
    with torch.no_grad():
        parts = []
        for span in rows.spans():
            inputs = rows.inputs[span]
            missing = min(window - 1, len(inputs))
            parts.append(inputs.new_full((missing, encoder.output.out_features), float("nan")))
            for start in range(0, len(inputs) - missing, _CHUNK):
                chunk = inputs[start : start + _CHUNK + window - 1]
                parts.append(encoder.encode_segments(chunk[None])[0])
        return torch.cat(parts)


def distil(
    teacher: Encoder,
    rows: Rows,
    chosen: Index,
    config: Config,
    *,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> Encoder:
    """Train an encoder on the chosen sensors to reproduce the teacher's latents.

    First as a stream, where 64 samples cost little more than one window does, then window by window, as it will run.
    Returns the slim encoder in evaluation mode, on the device of `rows`.

    Args:
        rows: with all sensors' columns.
        chosen: (N,) indices of the sensors, in the order of the slim encoder's inputs.
    """
    settings, device = config.train, rows.inputs.device
    target = encode_all(teacher, rows)
    slim_rows = rows.with_sensors(chosen)
    noise = slim_rows.noise(settings.sensor_noise)
    # No unroll here, and few inputs: sharing between neighbours would save nothing, so windows are drawn one by one.
    sampler = SegmentSampler(
        slim_rows, window=config.model.window, ahead=0, segment=1, batch_size=settings.batch_size, seed=settings.seed
    )
    schedule = Schedule(
        steps=sampler.steps(settings.distil_epochs), learning_rate=settings.learning_rate, shape=settings.schedule
    )
    with seeded(settings.seed, device):
        slim = Encoder(len(chosen), config.model).to(device)
        if settings.stream_epochs:
            fit_stream(slim, target, slim_rows, config, progress=progress, checkpoints=checkpoints)

        def loss(step: int) -> dict[str, Tensor]:
            batch = add_sensor_noise(sampler.batch(step), noise)
            return {"total": prediction_loss(slim.encode_segments(batch.inputs), target[batch.ends])}

        optimise(slim, loss, schedule, phase=Phase.DISTIL, progress=progress, checkpoints=checkpoints)
    return slim


_FEWER = 4
"""Times fewer roll-outs a batch than windows in training: each holds H predictions."""


def distil_predictor(
    lessons: Lessons,
    model: ModelConfig,
    settings: TrainConfig,
    *,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> Predictor:
    """Train dynamics and decoder of the slim widths to roll out as the teacher's do.

    The loss is the mean square of the latents' difference over h = 1 .. H plus the forces' Smooth L1 over h = 0 .. H,
    both in standard deviations, plus `slope_weight` times the square of the difference of the slopes, relative to the
    teacher's. Returns the student in evaluation mode, on the device of the lessons. The student has the slim widths of
    `model`.
    """
    device = lessons.actions.device
    batch_size = max(2, settings.batch_size // _FEWER)
    schedule = Schedule(
        steps=max(1, round(settings.predictor_epochs * len(lessons) / batch_size)),
        learning_rate=settings.learning_rate,
        shape=settings.schedule,
    )
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

        optimise(student, loss, schedule, phase=Phase.PREDICTOR, progress=progress, checkpoints=checkpoints)
    return student
