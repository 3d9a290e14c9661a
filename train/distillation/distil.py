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
"""Number of windows that are encoded together. The LSTM's work arrays then fit into the CPU's cache."""


def encode_all(encoder: Encoder, rows: Rows) -> Tensor:
    """Compute latents (n, N_z) of n rows: k is for the window that ends at row k; an episode's first L - 1 are NaN."""
    before, parts = encoder.window - 1, list[Tensor]()
    with torch.no_grad():
        for span in rows.spans():
            inputs = rows.inputs[span]
            missing = min(before, len(inputs))
            parts.append(inputs.new_full((missing, encoder.output.out_features), float("nan")))
            for start in range(0, len(inputs) - missing, _CHUNK):
                parts.append(encoder.encode_segments(inputs[None, start : start + _CHUNK + before])[0])
        return torch.cat(parts)


_MORE = 8
"""Batch size of the passes over streams, divided by the batch size of the passes over windows. Neighbouring latents of
a stream are similar, so more latents are needed, but each takes little time to compute."""


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

    The first passes read streams (this project's method): sequences of L - 1 + `STRETCH` rows, in which the LSTM starts
    from a zero state and is not reset. A latent then takes one LSTM step, instead of L steps for a window. The last
    `STRETCH` latents are used. An encoder that is trained in this way also reads windows well. The later passes read
    windows, as the vehicle does.
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
        # Each segment is a single window, because a slim encoder gains little from windows that overlap.
        fit(Phase.DISTIL, slim.encode_segments, settings.distil_epochs, 1, settings.batch_size)
    return slim
