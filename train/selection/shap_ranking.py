"""The paper's method of ranking sensors by their influence on the encoder (section 2.3.1 and appendix C)."""

import copy
from dataclasses import dataclass

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


def rank(
    ranker: "ShapRanker", encoder: Encoder, rows: Rows, *, repeats: int, seed: int, progress: Progress = silent
) -> Ranking:
    """Score the sensors `repeats` times with independent draws, and store every score."""
    scores = []
    for repeat in range(repeats):
        # The seeds are derived by a hash, because runs with neighbouring seeds must not share draws.
        draw = int(np.random.SeedSequence((seed, repeat)).generate_state(1)[0])
        scores.append(ranker(encoder, rows, draw))
        progress(Phase.RANK, repeat + 1, repeats, {})
    return Ranking(scores=np.stack(scores), names=rows.layout.names)


@dataclass(frozen=True, kw_only=True)
class ShapRanker:
    """A function that returns scores (N,) of N sensors; a higher score means a more important sensor. Scores are |SHAP|
    by expected gradients (`shap.GradientExplainer`), summed over the latents and averaged over the explained windows
    and the window's rows. The action's column is explained too, but left out of the scores.

    Attributes:
        background: number of windows that represent the typical input.
        explained: number of windows that are explained.
        samples: number of points on the paths from the background to each explained window.
    """

    background: int
    explained: int
    samples: int

    @classmethod
    def of(cls, settings: TrainConfig) -> "ShapRanker":
        """Build the ranker from the numbers of draws in the settings."""
        return cls(
            background=settings.shap_background, explained=settings.shap_explained, samples=settings.shap_samples
        )

    def __call__(self, encoder: Encoder, rows: Rows, seed: int) -> Array:
        """Return scores (N,) from windows drawn without replacement; raises DatasetError for too few windows."""
        generator = np.random.default_rng(seed)
        background = _draw(rows, encoder.window, self.background, "background", generator)
        explained = _draw(rows, encoder.window, self.explained, "explanation", generator)
        # Only gradients with respect to inputs are needed. In a frozen copy, gradients of the weights are not computed.
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
        """Return the sum of |SHAP| over packs, windows, rows and latents, (F,), for packs (P, M, L, F)."""
        # shap is imported here, because shap takes longer to load than torch, and no other selection method needs shap.
        import shap

        # Every position in a pack is combined with every background window, in its own random order.
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
"""Number of windows explained together. shap loops in Python over the samples and outputs of one input; with a pack,
one loop explains 25 windows. Latents of different windows do not interact, so explaining their sum explains each
window."""

_BATCH = 20
"""Number of packs per gradient: 500 windows, which fit into the processor's cache."""


class _Packed(nn.Module):
    """An encoder of B packs of M windows, (B, M, L, F), whose output (B, N_z) is the sum of the latents over each
    pack."""

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
