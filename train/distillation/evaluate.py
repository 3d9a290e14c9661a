"""The errors on test episodes (paper, section 3.1): forces decoded from the latents, and open-loop prediction.

R2 = 1 - sum (C - C_hat)^2 / sum (C - mean C)^2, and L1/sigma = mean |C - C_hat| / std C, both over the test episodes.
Neither number depends on the scaling, so scaled forces are used.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from contract.arrays import Index
from contract.errors import DatasetError
from contract.recording.needs import HORIZONS as HORIZONS
from train.distillation.distil import encode_all
from train.networks.model import Encoder, Predictor, WakeModel
from train.networks.samples import Rows


@dataclass(frozen=True, kw_only=True)
class ForceError:
    """The errors of one force that is decoded from the encoder's latents without prediction."""

    r2: float
    l1_over_sigma: float


@dataclass(frozen=True, kw_only=True)
class RolloutError:
    """The values of L1/sigma after `horizon` steps of the dynamics with the recorded actions. Predicted latents are
    compared with the encoder's latents at the same time. `latent` is the mean over the dimensions; each dimension has
    its own sigma. Decoded forces are compared with the recorded forces."""

    horizon: int
    latent: float
    drag: float
    lift: float


@dataclass(frozen=True, kw_only=True)
class EncoderMetrics:
    """The errors of an encoder that is used with a dynamics network and a decoder."""

    drag: ForceError
    lift: ForceError
    rollout: tuple[RolloutError, ...]


@dataclass(frozen=True, kw_only=True)
class ModelMetrics:
    """The errors of a trained model on the test episodes. `slim` is for the slim encoder with the teacher's dynamics
    and decoder. `deployed` is for the slim encoder with the narrower networks, if the model has them. `slim_latent` is
    L1/sigma of the slim encoder's latents, compared with the teacher's latents."""

    teacher: EncoderMetrics
    slim: EncoderMetrics
    slim_latent: float
    deployed: EncoderMetrics | None = None


def evaluate_model(
    teacher: WakeModel, slim: Encoder, predictor: Predictor | None, rows: Rows, chosen: Index
) -> ModelMetrics:
    """Compute all errors on test rows with all sensors; `chosen` (N,) are the slim encoder's. Raises as `evaluate`."""
    slim_rows = rows.with_sensors(chosen)
    return ModelMetrics(
        teacher=evaluate(teacher.encoder, teacher, rows),
        slim=evaluate(slim, teacher, slim_rows),
        slim_latent=latent_error(encode_all(slim, slim_rows), encode_all(teacher.encoder, rows)),
        deployed=None if predictor is None else evaluate(slim, predictor, slim_rows),
    )


def evaluate(
    encoder: Encoder, predictor: Predictor | WakeModel, rows: Rows, *, horizons: Sequence[int] = HORIZONS
) -> EncoderMetrics:
    """Compute the errors of an encoder with the given dynamics and decoder, on test rows with the encoder's sensors.
    All windows are evaluated. Roll-outs start from all windows that are followed by enough rows for the longest
    horizon. Raises DatasetError if no episode is long enough, or a force or latent is constant."""
    latents, dynamics, decoder = encode_all(encoder, rows), predictor.dynamics, predictor.decoder
    longest, full = max(horizons), ~latents[:, 0].isnan()
    reference = rows.forces[full]
    with torch.no_grad():
        decoded = decoder(latents[full])
        starts = rollout_starts(rows, encoder.window, longest)
        actions = rows.actions[starts[:, None] + torch.arange(longest, device=starts.device)]
        predicted = dynamics.rollout(latents[starts], actions)
        force_sigma, latent_sigma = _sigma(reference), _sigma(latents[full])
        rollout = []
        for horizon in horizons:
            after = starts + horizon
            latent_error = (predicted[horizon - 1] - latents[after]).abs().mean(dim=0) / latent_sigma
            force_error = (decoder(predicted[horizon - 1]) - rows.forces[after]).abs().mean(dim=0) / force_sigma
            drag, lift = force_error.tolist()
            rollout.append(RolloutError(horizon=horizon, latent=latent_error.mean().item(), drag=drag, lift=lift))
    drag_error, lift_error = (_force_error(decoded[:, i], reference[:, i]) for i in range(2))
    return EncoderMetrics(drag=drag_error, lift=lift_error, rollout=tuple(rollout))


def latent_error(latents: Tensor, reference: Tensor) -> float:
    """Compute L1/sigma of an encoder's latents (n, N_z), compared with the latents of a reference encoder, as the mean
    over dimensions. Rows with NaN are skipped. Raises DatasetError if a latent is constant."""
    full = ~reference[:, 0].isnan()
    error = (latents[full] - reference[full]).abs().mean(dim=0) / _sigma(reference[full])
    return error.mean().item()


def _force_error(decoded: Tensor, reference: Tensor) -> ForceError:
    residual = reference - decoded
    spread = reference - reference.mean()
    return ForceError(
        r2=1.0 - (residual.square().sum() / spread.square().sum()).item(),
        l1_over_sigma=(residual.abs().mean() / spread.square().mean().sqrt()).item(),
    )


def _sigma(values: Tensor) -> Tensor:
    sigma = values.std(dim=0, correction=0)
    if not bool((sigma > 0).all()):
        raise DatasetError("test episodes: a force or latent is constant, so errors cannot be normalised")
    return sigma


def rollout_starts(rows: Rows, window: int, longest: int) -> Tensor:
    """Return the indices (m,) of the m rows at which a window ends and after which the episode has at least `longest`
    rows. Raises DatasetError if there is no such row."""
    starts = [
        torch.arange(span.start + window - 1, span.stop - longest)
        for span in rows.spans()
        if span.stop - span.start >= window + longest
    ]
    if not starts:
        raise DatasetError(f"test episodes are too short: a window of {window} and {longest} steps ahead are needed")
    return torch.cat(starts).to(rows.inputs.device)
