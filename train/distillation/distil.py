"""The slim encoder, which computes the teacher's latents from few sensors (paper, section 2.3.2).

    L_distil = 1/(B N_z) sum || z_target - z_slim ||^2

over B windows and N_z latent dimensions. The teacher does not change, so its latents are computed only once.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from contract.arrays import Index
from contract.config.tree import Config
from contract.recording.needs import STRETCH as STRETCH
from train.fitting.fit import optimise, seeded
from train.fitting.progress import Phase, Progress, silent
from train.fitting.unfinished import Checkpoints
from train.networks.model import Encoder, prediction_loss
from train.networks.samples import Rows, SegmentSampler, add_sensor_noise

_CHUNK = 1024
"""Number of windows that are encoded together. For this number, the LSTM's gates fit into the processor's cache."""


def encode_all(encoder: Encoder, rows: Rows) -> Tensor:
    """Compute latents (n, N_z). Row k is for the window that ends at k; an episode's first L - 1 rows are NaN."""
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


_MORE = 8
"""Ratio of the batch size on a stream to the batch size on windows. It is larger than 1 because neighbouring latents
are similar, and additional latents of a stream cost little."""


def distil(
    teacher: Encoder,
    rows: Rows,
    chosen: Index,
    config: Config,
    *,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> Encoder:
    """Train an encoder to reproduce the teacher's latents. `chosen` (N,) are the sensors that this encoder reads, in
    order; `rows` have all sensors' columns. Returns the slim encoder in evaluation mode, on the device of `rows`.
    Raises DatasetError if an episode has fewer than L rows or, with `train.stream_epochs`, L - 1 + `STRETCH` rows.

    The first passes read the recording as a stream (this project's method), which has one LSTM step for each sample
    instead of L steps, because the LSTM's state is not reset. Training reads sequences of L - 1 + `STRETCH` rows from a
    zero state and uses the last `STRETCH` latents. The encoder then also reads windows well, so these cheap passes
    prepare the later passes, which read windows, as on the vehicle.
    """
    settings, device = config.train, rows.inputs.device
    target = encode_all(teacher, rows)
    slim_rows = rows.with_sensors(chosen)
    noise = slim_rows.noise(settings.sensor_noise)
    with seeded(settings.seed, device):
        slim = Encoder(len(chosen), config.model).to(device)

        def fit(phase: Phase, encode: Callable[[Tensor], Tensor], epochs: float, segment: int, batch_size: int) -> None:
            sampler = SegmentSampler(
                slim_rows, window=teacher.window, ahead=0, segment=segment, batch_size=batch_size, seed=settings.seed
            )

            def loss(step: int) -> dict[str, Tensor]:
                batch = add_sensor_noise(sampler.batch(step), noise)
                return {"total": prediction_loss(encode(batch.inputs), target[batch.ends])}

            optimise(
                slim, loss, sampler.steps(epochs), settings, phase=phase, progress=progress, checkpoints=checkpoints
            )

        if settings.stream_epochs:
            fit(Phase.STREAM, slim.encode_stream, settings.stream_epochs, STRETCH, settings.batch_size * _MORE)
        # Windows are drawn independently. Overlapping windows could share computations, but would save no time here,
        # because there is no unroll and there are few inputs.
        fit(Phase.DISTIL, slim.encode_segments, settings.distil_epochs, 1, settings.batch_size)
    return slim
