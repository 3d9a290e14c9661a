"""The encoder as a stream: one LSTM step a sample, state carried on, instead of a window of L steps (ours).

The networks are the windowed encoder's; what differs is the rows that the state has read. A windowed encoder starts
from zero in every window and forgets a bad sample after L of them; a stream does 1/L of the work and remembers for as
long as its gates let it. Training reads stretches of L - 1 + `STRETCH` rows from a zero state and counts the last
`STRETCH` latents, so that one pass through the LSTM gives `STRETCH` samples. An encoder trained that way also reads
windows well: it was trained on states of every age from L on. That makes it the cheap start of a windowed one
(`train.distillation.distil`).
"""

import torch
from torch import Tensor

from contract.config.tree import Config
from contract.recording.needs import STRETCH as STRETCH
from train.fitting.fit import Checkpoints, Schedule, optimise
from train.fitting.progress import Phase, Progress, silent
from train.networks.loss import prediction_loss
from train.networks.model import Encoder
from train.samples.rows import Rows
from train.samples.sampler import SegmentSampler, add_sensor_noise

_MORE = 8
"""Times the batch of windowed training: neighbouring latents resemble each other, and here they are nearly free."""


def encode_stream(encoder: Encoder, rows: Rows) -> Tensor:
    """Latents with the state carried through each episode, (n, N_z), one for each row.

    The first L - 1 of an episode are NaN, as in `train.distillation.distil.encode_all`: the state has settled by then.
    """
    with torch.no_grad():
        parts = []
        for span in rows.spans():
            hidden, _ = encoder.lstm(rows.inputs[None, span])
            latents = encoder.read_out(hidden[0])
            latents[: encoder.window - 1] = float("nan")
            parts.append(latents)
        return torch.cat(parts)


def fit_stream(
    student: Encoder,
    target: Tensor,
    rows: Rows,
    config: Config,
    *,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> None:
    """Train an encoder to reproduce `target`, (n, N_z) latents of the rows (its sensors' columns), read as a stream.

    In place, over `config.train.stream_epochs`; call inside `train.fitting.fit.seeded`. Raises DatasetError if an
    episode is too short for a window and a stretch.
    """
    settings, window = config.train, config.model.window
    sampler = SegmentSampler(
        rows, window=window, ahead=0, segment=STRETCH, batch_size=settings.batch_size * _MORE, seed=settings.seed
    )
    noise = rows.noise(settings.sensor_noise)
    schedule = Schedule(
        steps=sampler.steps(settings.stream_epochs), learning_rate=settings.learning_rate, shape=settings.schedule
    )

    def loss(step: int) -> dict[str, Tensor]:
        batch = add_sensor_noise(sampler.batch(step), noise)
        return {"total": prediction_loss(student.encode_stream(batch.inputs), target[batch.ends])}

    optimise(student, loss, schedule, phase=Phase.STREAM, progress=progress, checkpoints=checkpoints)
