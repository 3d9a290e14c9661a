"""A student reproduces the teacher's latents when its sensors hold them.

Narrow dynamics and decoder roll out as their teacher does, under actions it was never recorded with.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from contract.release.manifest import Scaling
from train.distillation.distil import distil, encode_all
from train.distillation.evaluate import latent_error, rollout_starts
from train.distillation.lessons import distil_predictor, teach
from train.fitting.fit import fit_joint, seeded
from train.networks.model import Predictor, WakeModel
from train.networks.samples import Rows, fit_scaling, prepare


def test_encode_all_is_the_encoder_window_by_window(small_recording, small_config):
    episodes = small_recording.with_role("train")
    rows = prepare(episodes, fit_scaling(episodes), mirrored=False)
    encoder = WakeModel(90, small_config.model).encoder
    latents = encode_all(encoder, rows)
    window = small_config.model.window
    assert latents.shape == (400, small_config.model.latent)
    for span in rows.spans():
        assert bool(latents[span.start : span.start + window - 1].isnan().all())
        for end in (span.start + window - 1, span.stop - 1):
            expected = encoder(rows.inputs[None, end - window + 1 : end + 1])[0]
            torch.testing.assert_close(latents[end], expected, rtol=1e-4, atol=1e-5)
    assert int(latents[:, 0].isnan().sum()) == 2 * (window - 1)


@pytest.fixture
def prepared(foreign_recording) -> tuple[Rows, Rows, Scaling]:
    """Rows to learn from and to judge on."""
    layout, training = foreign_recording.layout, foreign_recording.with_role("train")[:2]
    scaling = fit_scaling(training, layout)
    rows, test = (
        prepare(episodes, scaling, mirrored=False, layout=layout)
        for episodes in (training, foreign_recording.with_role("test"))
    )
    return rows, test, scaling


@pytest.mark.slow  # trains
def test_the_student_follows_a_frozen_teacher(prepared, small_config):
    rows, test, _ = prepared
    config = replace(small_config, train=replace(small_config.train, stream_epochs=40.0, distil_epochs=20.0))
    with seeded(5, torch.device("cpu")):
        teacher = WakeModel(7, config.model).encoder
    before = [parameter.clone() for parameter in teacher.parameters()]
    chosen = np.array([0, 2, 4, 5])
    slim = distil(teacher, rows, chosen, config)
    assert slim.lstm.input_size == 5
    assert all(torch.equal(a, b) for a, b in zip(before, teacher.parameters(), strict=True))
    error = latent_error(encode_all(slim, test.with_sensors(chosen)), encode_all(teacher, test))
    # measured 0.07; a student that gives the mean scores 0.86
    assert error < 0.25
    assert latent_error(encode_all(teacher, test), encode_all(teacher, test)) == 0.0


@pytest.mark.proofs  # trains for some seconds; test_distil.py stays
@pytest.mark.slow
def test_the_student_rolls_out_as_the_teacher(prepared, small_config):
    rows, test, scaling = prepared
    teacher = fit_joint(rows, replace(small_config, train=replace(small_config.train, epochs=20.0)))
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
