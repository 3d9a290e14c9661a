"""The narrower dynamics and decoder for small ECUs, distilled on roll-outs of trained networks (this project's method).

The paper makes only the encoder smaller. But the other two networks take nearly all the time of a control step. So a
student, a narrower version of these two networks, learns from lessons. A lesson has a roll-out of `horizon` steps from
a latent of the vehicle's encoder, the forces, and the gradient of the controller's cost with respect to the plan. The
optimiser uses only this gradient (Sobolev training, Czarnecki et al. 2017).

The trained predictor, the teacher, gives a roll-out for any actions. A quarter of the lessons use the actions that were
recorded after the lesson's first state, and a quarter use actions from other places in the recording. The other half
use plans from an optimisation: a plan begins with recorded actions, and gradient steps then lower the cost that the
teacher predicts for the plan.

Shapes: B plans of H actions, N_z latent dimensions. Latents, actions and forces are standardised.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor, nn

from contract.config.controller import CostWeights
from contract.config.learning import ModelConfig, TrainConfig
from contract.config.tree import Config
from contract.release.manifest import Scaling
from train.distillation.evaluate import rollout_starts
from train.fitting.fit import optimise, seeded
from train.fitting.progress import Phase, Progress, silent
from train.fitting.unfinished import Checkpoints
from train.networks.model import Predictor, WakeModel, prediction_loss
from train.networks.samples import Rows


def predict(model: Predictor | WakeModel, latent: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
    """Return latents (H + 1, B, N_z) and forces (H + 1, B, 2) at t .. t+H, from latents (B, N_z) and actions (B, H)."""
    latents = torch.cat([latent[None], model.dynamics.rollout(latent, actions)])
    return latents, model.decoder(latents)


def force_slope(forces: Tensor, weights: CostWeights, scaling: Scaling) -> Tensor:
    """Compute the derivatives of the cost (paper, equations 12-15) with respect to the standardised forces, (H, B, 2).
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


def plan_slope(forces: Tensor, actions: Tensor, by_force: Tensor, *, differentiable: bool = False) -> Tensor:
    """Compute the gradient of a cost with respect to the plans' actions, (B, H). `by_force` (H, B, 2) is the gradient
    with respect to the forces at t+1 .. t+H. `forces` (H + 1, B, 2) are the forces of the actions' roll-out, with their
    autograd graph. If `differentiable`, the result can be differentiated with respect to the networks' weights."""
    (slope,) = torch.autograd.grad(forces[1:], actions, by_force, create_graph=differentiable, retain_graph=True)
    return slope


_TOGETHER = 256
"""Number of roll-outs of the teacher that are computed together."""
_STEPS_DOWN = 16
"""Number of gradient steps that lower a plan's cost. A lesson is made before each step."""
_LONGEST_STEP = 4e-3
"""Largest change of an action in a gradient step, in U_inf W. The steps are random; their mean is half as large."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lessons:
    """A set of n roll-outs of H steps, with standardised values: actions (n, H) at t .. t+H-1, latents (n, H + 1, N_z)
    and forces (n, H + 1, 2) at t .. t+H by the teacher's dynamics and decoder, and the gradients of the cost with
    respect to the forces at t+1 .. t+H (n, H, 2) and to the actions (n, H)."""

    actions: Tensor
    latents: Tensor
    forces: Tensor
    by_force: Tensor
    slope: Tensor

    def __len__(self) -> int:
        return len(self.actions)

    def drawn(self, which: Tensor) -> "Lessons":
        """Return the lessons with the given indices (B,)."""
        return Lessons(**{item.name: getattr(self, item.name)[which] for item in fields(self)})


def teach(
    teacher: WakeModel, latents: Tensor, rows: Rows, scaling: Scaling, config: Config, *, progress: Progress = silent
) -> Lessons:
    """Compute at least `config.train.predictor_lessons` lessons; equal seeds give equal lessons. `latents` (n, N_z) are
    computed from the n rows by the vehicle's encoder. Raises DatasetError if all episodes are too short."""
    starts = rollout_starts(rows, config.model.window, config.mpc.horizon)
    ahead = torch.arange(config.mpc.horizon, device=starts.device)
    generator = np.random.default_rng(config.train.seed)
    batches = max(1, -(-config.train.predictor_lessons // (2 * _TOGETHER * _STEPS_DOWN)))
    taught: list[Lessons] = []

    def kept(lessons: Lessons) -> Lessons:
        taught.append(lessons)
        progress(Phase.LESSONS, len(taught), 2 * batches * _STEPS_DOWN, {})
        return lessons

    def drawn() -> tuple[Tensor, Tensor]:
        which = torch.as_tensor(generator.integers(len(starts), size=(2, _TOGETHER)), device=starts.device)
        begin, elsewhere = starts[which]
        elsewhere[::2] = begin[::2]
        return latents[begin], rows.actions[elsewhere[:, None] + ahead]

    limit = config.flow.action_limit / scaling.action_std
    for _ in range(batches):
        latent, plans = drawn()
        for _ in range(_STEPS_DOWN):
            lesson = kept(_lesson(teacher, latent, plans, scaling, config))
            step = torch.as_tensor(generator.random((_TOGETHER, 1)), dtype=plans.dtype, device=plans.device)
            down = step * _LONGEST_STEP / scaling.action_std * lesson.slope.sign()
            plans = (plans - down).clamp(-limit, limit)
            kept(_lesson(teacher, *drawn(), scaling, config))
    return Lessons(**{item.name: torch.cat([getattr(one, item.name) for one in taught]) for item in fields(Lessons)})


def _lesson(teacher: WakeModel, latent: Tensor, actions: Tensor, scaling: Scaling, config: Config) -> Lessons:
    with torch.enable_grad():
        leaf = actions.detach().requires_grad_(True)
        latents, forces = predict(teacher, latent, leaf)
        by_force = force_slope(forces[1:], config.mpc.weights, scaling)
        slope = plan_slope(forces, leaf, by_force)
    latents, forces, by_force = (one.detach().transpose(0, 1) for one in (latents, forces, by_force))
    return Lessons(actions=actions, latents=latents, forces=forces, by_force=by_force, slope=slope)


_FEWER = 4
"""Divisor of `train.batch_size` for roll-outs. A roll-out has H predictions, so fewer roll-outs are enough."""


def distil_predictor(
    lessons: Lessons,
    model: ModelConfig,
    settings: TrainConfig,
    *,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> Predictor:
    """Train a dynamics network and a decoder with the slim widths to reproduce the teacher's roll-outs.

    The loss is the sum of three terms. The first term is the mean square of the latents' difference over h = 1 .. H.
    The second term is the Smooth L1 loss of the forces' difference over h = 0 .. H. Latents and forces are in standard
    deviations. The third term is `slope_weight` times the mean square difference between the student's and the
    teacher's gradients of the cost, divided by the mean square of the teacher's gradient. Returns the student in
    evaluation mode, with the slim widths of `model`, on the lessons' device.
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
                one.transpose(0, 1) for one in (lesson.latents, lesson.forces, lesson.by_force)
            )
            actions = lesson.actions.requires_grad_(True)
            found_latents, found_forces = predict(student, latents[0], actions)
            terms = {
                "prediction": prediction_loss(found_latents[1:], latents[1:]),
                "force": nn.functional.smooth_l1_loss(found_forces, forces),
            }
            total = terms["prediction"] + terms["force"]
            if settings.slope_weight:
                slope = plan_slope(found_forces, actions, by_force, differentiable=True)
                terms["slope"] = (slope - lesson.slope).square().mean() / lesson.slope.square().mean()
                total = total + settings.slope_weight * terms["slope"]
            return {"total": total, **terms}

        optimise(student, loss, steps, settings, phase=Phase.PREDICTOR, progress=progress, checkpoints=checkpoints)
    return student
