"""The paper's method: which sensors the encoder depends on (section 2.3.1 and appendix C).

A `Ranker` scores the sensors once; `rank` repeats it with fresh draws and keeps every score. The paper's
ranker is `ShapRanker`.
"""

import copy
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor, nn

from contract.arrays import Array
from contract.config.learning import TrainConfig
from contract.errors import DatasetError
from train.fitting.progress import Phase, Progress, silent
from train.networks.model import Encoder
from train.samples.rows import Rows
from train.selection.ranking import Ranking
from train.selection.ridge_student import first_rows, windows_at


class Ranker(Protocol):
    """Scores of the N sensors, (N,), larger is more important; one independent draw per seed."""

    def __call__(self, encoder: Encoder, rows: Rows, seed: int) -> Array: ...


def rank(
    ranker: Ranker, encoder: Encoder, rows: Rows, *, repeats: int, seed: int, progress: Progress = silent
) -> Ranking:
    """Score the sensors `repeats` times with independent draws."""
    scores = []
    for repeat in range(repeats):
        # Spawned seeds: neighbouring run seeds must not share draws.
        draw = int(np.random.SeedSequence((seed, repeat)).generate_state(1)[0])
        scores.append(ranker(encoder, rows, draw))
        progress(Phase.RANK, repeat + 1, repeats, {})
    return Ranking(scores=np.stack(scores), names=rows.layout.names)


@dataclass(frozen=True, kw_only=True)
class ShapRanker:
    """Mean |SHAP| by expected gradients (`shap.GradientExplainer`).

    |SHAP| of every sensor, window row and latent is summed over the latents and averaged over the explained
    windows and the window's rows. The action's column is explained with the rest and left out of the scores.

    Attributes:
        background: windows that stand for "no information".
        samples: points on the paths between them, for each explained window.
    """

    background: int
    explained: int
    samples: int

    @classmethod
    def of(cls, settings: TrainConfig) -> "ShapRanker":
        """The ranker with the numbers of draws of those settings."""
        return cls(
            background=settings.shap_background, explained=settings.shap_explained, samples=settings.shap_samples
        )

    def __call__(self, encoder: Encoder, rows: Rows, seed: int) -> Array:
        """Scores (N,); windows are drawn from `rows` without replacement. Raises DatasetError if `rows` hold fewer
        windows than are to be drawn."""
        generator = np.random.default_rng(seed)
        background = _draw(rows, encoder.window, self.background, "background", generator)
        explained = _draw(rows, encoder.window, self.explained, "explanation", generator)
        # Gradients are wanted with respect to inputs only; a frozen copy spares those of the weights.
        packed = _Packed(copy.deepcopy(encoder).requires_grad_(False))
        total = np.zeros(explained.shape[2])
        full = len(explained) // _PACK * _PACK
        if full:
            packs = explained[:full].view(-1, _PACK, *explained.shape[1:])
            total += self._magnitude(packed, background, packs, generator)
        if full < len(explained):
            total += self._magnitude(packed, background, explained[full:][None], generator)
        scores: Array = total[: rows.sensors] / (len(explained) * encoder.window)
        return scores

    def _magnitude(self, packed: "_Packed", background: Tensor, packs: Tensor, generator: np.random.Generator) -> Array:
        """Sum of |SHAP| over packs, windows, rows and latents: (P, M, L, F) packs -> (F,)."""
        # Here, because loading it takes longer than loading torch, and no other method of selection needs it.
        import shap

        # Every place in a pack meets every background window, in an order of its own.
        order = np.stack([generator.permutation(len(background)) for _ in range(packs.shape[1])], axis=1)
        explainer = shap.GradientExplainer(packed, background[torch.as_tensor(order)], batch_size=_BATCH)
        state = np.random.get_state()  # shap seeds numpy's global generator
        try:
            values = explainer.shap_values(packs, nsamples=self.samples, rseed=int(generator.integers(2**31)))
        finally:
            np.random.set_state(state)
        magnitude: Array = np.abs(values).sum(axis=(0, 1, 2, 4))
        return magnitude


_PACK = 25
"""Windows explained together. shap loops in Python over samples and outputs of one input; a pack makes that one
loop serve 25 windows. Latents of different windows do not interact, so explaining their sum explains each."""

_BATCH = 20
"""Packs a gradient is taken of at once: 500 windows, which stay in the processor's cache."""


class _Packed(nn.Module):
    """(B, M, L, F) packs of windows -> (B, N_z) latents summed over the pack."""

    def __init__(self, encoder: Encoder) -> None:
        super().__init__()
        self.encoder = encoder

    def forward(self, packs: Tensor) -> Tensor:
        latents: Tensor = self.encoder(packs.flatten(0, 1))
        return latents.view(*packs.shape[:2], -1).sum(dim=1)


def _draw(rows: Rows, window: int, count: int, purpose: str, generator: np.random.Generator) -> Tensor:
    firsts = first_rows(rows, window)
    if len(firsts) < count:
        raise DatasetError(f"recording has {len(firsts)} windows, too few to draw {count} {purpose} samples")
    return windows_at(rows, generator.choice(firsts, count, replace=False), window)
