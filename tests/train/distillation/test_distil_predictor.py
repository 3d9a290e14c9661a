"""Narrow dynamics and decoder roll out as their teacher does, under actions it was never recorded with."""

from dataclasses import replace

import pytest
import torch

from train.distillation.distil import distil_predictor, encode_all
from train.distillation.evaluate import rollout_starts
from train.distillation.lessons import teach
from train.networks.model import Predictor


@pytest.mark.proofs  # trains for some seconds; test_distil.py stays
@pytest.mark.slow
def test_the_student_rolls_out_as_the_teacher(fitted, small_config):
    teacher, scaling, rows, test = fitted.model, fitted.scaling, fitted.rows, fitted.unseen
    config = replace(
        small_config,
        model=replace(small_config.model, slim_dynamics_width=24, slim_decoder_width=16),
        train=replace(small_config.train, predictor_lessons=2048, predictor_epochs=2.5),
        mpc=replace(small_config.mpc, horizon=10),
    )
    before = [parameter.clone() for parameter in teacher.parameters()]
    latents = encode_all(teacher.encoder, rows)
    lessons = teach(teacher, latents, rows, scaling, config)
    student = distil_predictor(lessons, config.model, config.train)
    assert all(torch.equal(a, b) for a, b in zip(before, teacher.parameters(), strict=True))
    assert (student.dynamics.hidden.in_features, student.decoder.input.out_features) == (24, 16)

    starts = rollout_starts(test, config.model.window, config.mpc.horizon)
    latent = encode_all(teacher.encoder, test)[starts]
    # The held-out actions, in an order that never met these starts.
    elsewhere = starts[torch.randperm(len(starts), generator=torch.Generator().manual_seed(3))]
    actions = test.actions[elsewhere[:, None] + torch.arange(config.mpc.horizon)]

    def error(model: Predictor) -> float:
        with torch.no_grad():
            forces = teacher.decoder(teacher.dynamics.rollout(latent, actions))
            found = model.decoder(model.dynamics.rollout(latent, actions))
            return ((found - forces).abs().mean() / forces.std()).item()

    torch.manual_seed(0)
    untrained = error(Predictor(config.model.slim))
    assert untrained > 0.6
    assert error(student) < 0.25
