"""The batches of windows for training: contiguous segments of rows, chosen randomly from seed and step."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from contract.arrays import Index
from contract.errors import DatasetError
from train.samples.rows import Rows


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """A batch of S segments. A segment has W windows of L rows; the windows end at the segment's last W rows. `actions`
    (S, W) and `forces` (S, W, 2) are values at these ends. `ends` (S, W) are the ends' indices among all rows. `inputs`
    are the encoder rows (S, W + L - 1, F) of F features."""

    inputs: Tensor
    actions: Tensor
    forces: Tensor
    ends: Tensor


class SegmentSampler:
    """A source of batches of contiguous segments. The batch of a step depends only on the seed and the step. A sample
    is a window and the `ahead` windows that follow it. Segments hold `segment` consecutive samples, so one segment has
    W = segment + ahead windows. Each pass covers every episode with shuffled segments from a random offset."""

    def __init__(self, rows: Rows, *, window: int, ahead: int, segment: int, batch_size: int, seed: int) -> None:
        """Prepare the sampler. Raises DatasetError if an episode is too short for one segment."""
        self.rows = rows
        self.segment = segment
        self._window, self._windows, self._seed = window, segment + ahead, seed
        needed = window - 1 + self._windows
        for number, length in enumerate(rows.lengths):
            if length < needed:
                raise DatasetError(
                    f"episode {rows.name_of(number)} has {length} steps, too short: a window of {window}, "
                    f"{ahead} steps ahead and segments of {segment} need {needed}"
                )
        self.samples = sum(length - needed + segment for length in rows.lengths)
        self._segments = max(1, batch_size // segment)
        self._batches = -(-self.samples // (self._segments * segment))
        self._cached: tuple[int, Index] = (-1, np.empty(0, dtype=np.intp))

    def steps(self, epochs: float) -> int:
        """Return the number of batches in `epochs` passes over all samples, at least 1."""
        return max(1, round(epochs * self.samples / (self._segments * self.segment)))

    def first_rows(self, step: int) -> Index:
        """Return the index of the first row of each segment in the batch, (S,)."""
        epoch, position = divmod(step, self._batches)
        if self._cached[0] != epoch:
            self._cached = (epoch, self._shuffled(epoch))
        order = self._cached[1]
        wanted = np.arange(position * self._segments, (position + 1) * self._segments)
        return order[wanted % len(order)]

    def batch(self, step: int) -> Batch:
        """Return the batch of a step."""
        rows = self.rows
        first = torch.as_tensor(self.first_rows(step), device=rows.inputs.device)[:, None]
        span = first + torch.arange(self._window - 1 + self._windows, device=first.device)
        ends = span[:, self._window - 1 :]
        return Batch(inputs=rows.inputs[span], actions=rows.actions[ends], forces=rows.forces[ends], ends=ends)

    def _shuffled(self, epoch: int) -> Index:
        generator = np.random.default_rng((self._seed, epoch))
        firsts = []
        for span in self.rows.spans():
            last = span.stop - span.start - (self._window - 1 + self._windows)
            phase = generator.integers(self.segment)
            # Both ends are clipped to the episode, so that every pass covers every sample.
            tiles = np.arange(-phase, last + self.segment, self.segment).clip(0, last)
            firsts.append(span.start + np.unique(tiles))
        return generator.permutation(np.concatenate(firsts))


def add_sensor_noise(batch: Batch, deviation: Tensor) -> Batch:
    """Add white noise with standard deviations (N,) to the N sensors of a batch, from torch's generator; a deviation of
    zero adds no noise."""
    if not bool(deviation.any()):
        return batch
    noise = torch.randn(*batch.inputs.shape[:2], len(deviation), device=batch.inputs.device) * deviation
    return replace(batch, inputs=torch.cat([batch.inputs[..., :-1] + noise, batch.inputs[..., -1:]], dim=-1))
