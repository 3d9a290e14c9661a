"""Training of an encoder on a stream: one LSTM step for each sample instead of L steps, because the LSTM's state is not
reset (this project's method).

The networks are those of the windowed encoder, which starts from a zero state in every window; a streamed encoder's
state can depend on all earlier rows. Training reads sequences of L - 1 + `STRETCH` rows from a zero state and uses the
last `STRETCH` latents, so that one pass through the LSTM gives `STRETCH` samples. An encoder trained in this way also
reads windows well, so this is a cheap preparation of a windowed encoder (`train.distillation.distil`).
"""

from torch import Tensor

from contract.config.tree import Config
from contract.recording.needs import STRETCH as STRETCH
from train.fitting.checkpoint import Checkpoints
from train.fitting.fit import optimise
from train.fitting.progress import Phase, Progress, silent
from train.networks.loss import prediction_loss
from train.networks.model import Encoder
from train.samples.rows import Rows
from train.samples.sampler import SegmentSampler, add_sensor_noise

_MORE = 8
"""Ratio of the batch size to the batch size of windowed training. It is larger than 1 because neighbouring latents are
similar, and additional latents of a stream cost little."""


def fit_stream(
    student: Encoder,
    target: Tensor,
    rows: Rows,
    config: Config,
    *,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> None:
    """Train an encoder in place, over `config.train.stream_epochs`, to reproduce the n latents `target` (n, N_z) from
    rows of the encoder's sensors, read as a stream. Call this function inside `train.fitting.fit.seeded`. Raises
    DatasetError if an episode is too short for a window and a sequence of `STRETCH` rows."""
    settings, window = config.train, config.model.window
    sampler = SegmentSampler(
        rows, window=window, ahead=0, segment=STRETCH, batch_size=settings.batch_size * _MORE, seed=settings.seed
    )
    noise = rows.noise(settings.sensor_noise)

    def loss(step: int) -> dict[str, Tensor]:
        batch = add_sensor_noise(sampler.batch(step), noise)
        return {"total": prediction_loss(student.encode_stream(batch.inputs), target[batch.ends])}

    steps = sampler.steps(settings.stream_epochs)
    optimise(student, loss, steps, settings, phase=Phase.STREAM, progress=progress, checkpoints=checkpoints)
