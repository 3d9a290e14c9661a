"""A state carried along is the plain recurrence over the whole episode, and a student can be trained for it."""

from dataclasses import replace

import pytest
import torch

from contract import sensors
from train.distillation.distil import encode_all
from train.distillation.evaluate import latent_error
from train.fitting.fit import fit_joint, seeded
from train.fitting.progress import Phase
from train.fitting.streaming import encode_stream, fit_stream
from train.networks.model import Encoder, WakeModel
from train.samples.rows import fit_scaling, prepare


def test_a_stream_is_one_cell_step_a_sample(small_recording, small_config):
    episodes = small_recording.with_role("train")
    rows = prepare(episodes, fit_scaling(episodes), mirrored=False)
    torch.manual_seed(0)
    encoder = Encoder(90, small_config.model)
    cell = torch.nn.LSTMCell(91, small_config.model.lstm_width)
    for name, value in encoder.lstm.named_parameters():
        getattr(cell, name.removesuffix("_l0")).data = value.data
    latents = encode_stream(encoder, rows)
    window = small_config.model.window
    with torch.no_grad():
        for span in rows.spans():
            state = None
            for k, row in enumerate(rows.inputs[span]):
                state = cell(row[None], state)
                if k >= window - 1:
                    torch.testing.assert_close(latents[span][k], encoder.read_out(state[0])[0], rtol=1e-4, atol=1e-5)
            # The first window starts from zero in both readings.
            first = span.start + window - 1
            torch.testing.assert_close(latents[first], encode_all(encoder, rows)[first], rtol=1e-4, atol=1e-5)
    assert int(latents[:, 0].isnan().sum()) == 2 * (window - 1)


@pytest.mark.slow  # trains
def test_a_streaming_student_follows_the_teacher_past_the_stretches_it_learned_from(make_episode, small_config):
    training = [make_episode("waveform", "train", 600, 1)]
    scaling = fit_scaling(training)
    rows = prepare(training, scaling, mirrored=True)
    # Ten times as long as a stretch.
    test = prepare([make_episode("chirp", "test", 700, 3)], scaling, mirrored=False)
    config = replace(small_config, train=replace(small_config.train, stream_epochs=150.0))
    torch.manual_seed(5)
    teacher = WakeModel(90, config.model).encoder
    chosen = sensors.TRUCK.indices(["upper_39", "lower_39", "base_0", "base_9"])
    with seeded(0, torch.device("cpu")):
        student = Encoder(len(chosen), config.model)
        fit_stream(student, encode_all(teacher, rows), rows.with_sensors(chosen), config)
    error = latent_error(encode_stream(student, test.with_sensors(chosen)), encode_all(teacher, test))
    # measured 0.23; a student that gives the mean scores 0.8
    assert error < 0.3


@pytest.mark.slow
def test_the_fit_streams_and_the_finish_does_not(rows, small_config, monkeypatch):
    def refuse(encoder: Encoder, segments: torch.Tensor) -> torch.Tensor:
        raise AssertionError(segments.shape)

    finish = replace(small_config.train.finish, epochs=1.0, unroll=8)
    settings = replace(small_config.train, epochs=2.0, streamed=True, finish=finish)
    for name, phases in (("encode_stream", set()), ("encode_segments", {Phase.FIT})):
        seen: set[Phase] = set()
        with monkeypatch.context() as patch, pytest.raises(AssertionError):
            patch.setattr(Encoder, name, refuse)
            fit_joint(rows, replace(small_config, train=settings), progress=lambda phase, *_, to=seen: to.add(phase))
        assert seen == phases, name
