"""The paper's ranking of the sensors by their influence on the encoder (section 2.3.1 and appendix C)."""

import copy
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from contract.arrays import Array, Index
from contract.config.learning import TrainConfig
from contract.errors import ConfigError, DatasetError
from contract.sensors import NAMES
from train.fitting.progress import Phase, Progress, silent
from train.networks.model import Encoder
from train.networks.samples import Rows


def check_count(count: int, available: int) -> None:
    """Raise ConfigError unless the count is at least 1 and at most the number of available sensors."""
    if not 1 <= count <= available:
        raise ConfigError(f"train.sensors = {count}: must be from 1 to {available}, the number of sensors")


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranking:
    """The scores (repeats, N) of N named sensors. Each repeat draws other training windows."""

    scores: Array
    names: tuple[str, ...] = NAMES

    @property
    def mean(self) -> Array:
        """Mean of the N sensors' scores over the repeats, (N,)."""
        return np.asarray(self.scores.mean(axis=0))

    @property
    def std(self) -> Array:
        """Sample standard deviation of the N sensors' scores over the repeats, (N,); 0 if there is one repeat."""
        return self.scores.std(axis=0, ddof=1) if len(self.scores) > 1 else np.zeros(self.scores.shape[1])

    def top(self, count: int) -> tuple[str, ...]:
        """Return the names of the best sensors by mean score, best first; equal scores keep the sensors' order. Raises
        ConfigError if there are fewer sensors than `count`."""
        check_count(count, len(self.names))
        return self._names(_best(self.mean, count))

    def is_stable(self, count: int) -> bool:
        """Return whether every repeat has the same set of best sensors."""
        return not self.differences(count)

    def differences(self, count: int) -> Mapping[str, float]:
        """Return the sensors that are among the best in some repeats only, each with its fraction of the repeats. The
        sensors are in the order of `names`; the result is empty if the set is stable."""
        repeats = len(self.scores)
        counts = Counter(name for scores in self.scores for name in self._names(_best(scores, count)))
        return {name: counts[name] / repeats for name in self.names if 0 < counts[name] < repeats}

    def _names(self, chosen: Sequence[int] | Index) -> tuple[str, ...]:
        return tuple(self.names[index] for index in chosen)


def _best(scores: Array, count: int) -> Index:
    return np.argsort(-scores, kind="stable")[:count]


STABILITY_SETS: Final = (2, 4, 6, 8)
"""Sizes of the best sets whose stability over the repeats is reported (paper, appendix C)."""
GIVEN: Final = "given"
"""Name of the method if the caller chose the sensors."""


@dataclass(frozen=True, kw_only=True)
class SensorChoice:
    """The chosen sensors and the method: "shap.GradientExplainer", another `contract.config.learning.SelectionMethod`,
    or "given". For methods other than SHAP, all fields except `method` and `order` are None.

    Attributes:
        order: for SHAP the names of all sensors, best first; for the other methods the names of the chosen sensors.
        mean, std: (N,) mean and standard deviation of the N sensors' scores over the repeats.
        stable, differences: `Ranking.is_stable` and `Ranking.differences` by size of the set.
    """

    method: str
    repeats: int | None = None
    order: tuple[str, ...]
    mean: tuple[float, ...] | None = None
    std: tuple[float, ...] | None = None
    stable: Mapping[str, bool] | None = None
    differences: Mapping[str, Mapping[str, float]] | None = None

    @classmethod
    def of_ranking(cls, ranking: Ranking) -> "SensorChoice":
        """Build the choice from a ranking by the paper's method."""
        # The set of all sensors is always stable, so it is not reported.
        sizes = [count for count in STABILITY_SETS if count < len(ranking.names)]
        return cls(
            method="shap.GradientExplainer",
            repeats=len(ranking.scores),
            order=ranking.top(len(ranking.names)),
            mean=tuple(ranking.mean.tolist()),
            std=tuple(ranking.std.tolist()),
            stable={str(count): ranking.is_stable(count) for count in sizes},
            differences={str(count): dict(ranking.differences(count)) for count in sizes},
        )


def rank(encoder: Encoder, rows: Rows, settings: TrainConfig, *, progress: Progress = silent) -> Ranking:
    """Score the sensors `train.shap_repeats` times with independent draws. Raises the errors of `shap_scores`."""
    scores = []
    for repeat in range(settings.shap_repeats):
        # By hashing, runs with neighbouring seeds share no draws.
        draw = int(np.random.SeedSequence((settings.seed, repeat)).generate_state(1)[0])
        scores.append(shap_scores(encoder, rows, settings, draw))
        progress(Phase.RANK, repeat + 1, settings.shap_repeats, {})
    return Ranking(scores=np.stack(scores), names=rows.layout.names)


def shap_scores(encoder: Encoder, rows: Rows, settings: TrainConfig, seed: int) -> Array:
    """Return scores (N,) of N sensors from windows drawn without replacement; a higher score means a more important
    sensor. Scores are |SHAP| by expected gradients (`shap.GradientExplainer`), summed over the latents and averaged
    over the explained windows and the window's rows. Raises DatasetError for too few windows."""
    generator = np.random.default_rng(seed)
    background = _draw(rows, encoder.window, settings.shap_background, "background", generator)
    explained = _draw(rows, encoder.window, settings.shap_explained, "explanation", generator)
    # Only gradients with respect to inputs are needed. In a frozen copy, gradients of the weights are not computed.
    packed = _Packed(copy.deepcopy(encoder).requires_grad_(False))
    total = np.zeros(explained.shape[2])
    full = len(explained) // _PACK * _PACK
    for packs in (explained[:full].view(-1, _PACK, *explained.shape[1:]), explained[full:][None]):
        if packs.numel():
            total += _magnitude(packed, background, packs, settings.shap_samples, generator)
    return np.asarray(total[: rows.sensors] / (len(explained) * encoder.window))


def _magnitude(
    packed: "_Packed", background: Tensor, packs: Tensor, samples: int, generator: np.random.Generator
) -> Array:
    """Return the sum of |SHAP| over packs, windows, rows and latents, (F,), for packs (P, M, L, F)."""
    # shap is imported here, because shap takes longer to load than torch, and no other selection method needs shap.
    import shap

    # At every position in a pack, all background windows occur once, in a random order that differs between positions.
    order = np.stack([generator.permutation(len(background)) for _ in range(packs.shape[1])], axis=1)
    explainer = shap.GradientExplainer(packed, background[torch.as_tensor(order)], batch_size=_BATCH)
    state = np.random.get_state()  # shap seeds numpy's global generator
    try:
        values = explainer.shap_values(packs, nsamples=samples, rseed=int(generator.integers(2**31)))
    finally:
        np.random.set_state(state)
    return np.asarray(np.abs(values).sum(axis=(0, 1, 2, 4)))


_PACK = 25
"""Number of windows that are explained together, as one input of shap. For each input, shap loops in Python over all
samples and outputs, so a pack saves time. The output for a pack is the sum of the windows' latents. A window affects
only its own latents, so the explanation of the sum contains the explanation of each window."""
_BATCH = 20
"""Number of packs per gradient: 500 windows, which fit into the processor's cache."""


class _Packed(nn.Module):
    """An encoder of B packs of M windows, (B, M, L, F), whose output (B, N_z) sums the latents of each pack."""

    def __init__(self, encoder: Encoder) -> None:
        super().__init__()
        self.encoder = encoder

    def forward(self, packs: Tensor) -> Tensor:
        # cuDNN differentiates an LSTM only in training mode; an encoder has no dropout, so the mode changes no result.
        self.encoder.train()
        latents: Tensor = self.encoder(packs.flatten(0, 1))
        return latents.view(*packs.shape[:2], -1).sum(dim=1)


def _draw(rows: Rows, window: int, count: int, purpose: str, generator: np.random.Generator) -> Tensor:
    firsts = rows.first_rows(window)
    if len(firsts) < count:
        raise DatasetError(f"the recording has {len(firsts)} windows: too few for {count} {purpose} samples")
    return rows.windows_at(generator.choice(firsts, count, replace=False), window)
