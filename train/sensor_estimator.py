"""The training of the network for the ECU's sensor check, which estimates each pressure of a controller from the other
pressures. It learns from the recording's "train" episodes and their mirror images, with noise on the readings. Some
rows repeat the readings of the previous row, as on an ECU that loses frames.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from contract.arrays import Array
from contract.controller.estimator import EstimatorNetwork, views
from contract.errors import DatasetError
from contract.recording.dataset import Dataset
from train.fitting.fit import torch_threads

_WIDTHS: Final = (64, 64)
"""Widths of the hidden layers. A width of 192 is too large for a microcontroller."""
EPOCHS: Final = 60.0
BATCH: Final = 1024
LEARNING_RATE: Final = 3e-3
NOISE: Final = 0.5
"""Largest standard deviation of the noise, relative to the rms of the sensors' standard deviations. For each window it
is multiplied by the square of a uniform random number, so low noise is frequent."""
HELD: Final = 0.4
"""Largest fraction of a window's rows that repeat the readings of the previous row."""
GUST: Final = 0.15
"""Largest relative difference between the air speed and the speed that scales the pressures. Half of the windows have a
difference. The mean residual in a gust of 10 % is then 0.009 in Cp. A network trained without differences has 0.07,
four standard deviations of healthy sensors (held-out episodes of the shipped recording, pressures times 1.21)."""
WEIGHT_DECAY: Final = 1e-3
SEED: Final = 0
"""Random seed of initial weights, draws and noise; its value is arbitrary."""


def fit_estimator(
    recording: Dataset,
    sensors: Sequence[str],
    window: int,
    *,
    epochs: float = EPOCHS,
    threads: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> EstimatorNetwork:
    """Fit the estimator for a controller's sensors and window in `epochs` passes over the training windows, with
    `threads` of torch's threads. Raises ConfigError if the recording lacks a sensor, or `threads` is below 1;
    DatasetError if all episodes are short, or a value is constant. `progress` is called with (done, all) batches."""
    columns = recording.layout.indices(sensors)
    mirror = None if recording.layout.mirror is None else recording.layout.mirror[columns]
    used = [item for item in recording.with_role("train") if len(item) > window]
    if not used:
        raise DatasetError(f"no training episode is longer than the window of {window} control steps")
    learned = [item.rows(columns) for item in used]
    # Mirror images are not checked, because they would add another sensor's values to a dead sensor's column.
    for name, spread in zip((*sensors, "the action"), np.ptp(np.concatenate(learned), axis=0), strict=True):
        if spread == 0.0:
            raise DatasetError(f"{name} is constant in all training episodes: nothing to learn from")
    if mirror is not None:
        learned += [item.rows(mirror, sign=-1.0) for item in used]
    together = np.concatenate(learned)
    mean, std = together.mean(axis=0), together.std(axis=0)
    mean[-1] = 0.0
    with torch_threads(threads):
        return _fit(learned, mean, std, window, epochs, progress)


def _fit(
    learned: Sequence[Array], mean: Array, std: Array, window: int, epochs: float, progress: Callable[[int, int], None]
) -> EstimatorNetwork:
    generator = torch.Generator().manual_seed(SEED)
    sensors = len(mean) - 1
    rows = torch.tensor((np.concatenate(learned) - mean) / std, dtype=torch.float32)
    begins = np.cumsum([0, *(len(item) for item in learned[:-1])])
    starts = torch.tensor(
        np.concatenate([b + np.arange(len(item) - window + 1) for b, item in zip(begins, learned, strict=True)])
    )
    # Training windows have no exchanged sensors: the ECU's check undoes an exchange before it calls the network.
    hidden = torch.zeros(sensors + sensors * (sensors - 1) // 2, sensors)
    for flags, view in zip(hidden, views(sensors), strict=False):
        flags[list(view.left_out)] = 1.0
    unit = torch.tensor(np.sqrt(np.square(std[:-1]).mean()) / std[:-1], dtype=torch.float32)
    middle = torch.tensor(mean[:-1] / std[:-1], dtype=torch.float32)
    sizes = (window * (sensors + 1) + sensors, *_WIDTHS, sensors)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(SEED)
        linear = [nn.Linear(before, after) for before, after in pairwise(sizes)]
    model = nn.Sequential(linear[0], nn.ReLU(), linear[1], nn.ReLU(), linear[2])
    batches = max(1, round(epochs * len(starts) / BATCH))
    optimiser = torch.optim.AdamW(model.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, LEARNING_RATE, total_steps=batches)
    place = torch.arange(window)
    for done in range(batches):
        chosen = starts[torch.randint(len(starts), (BATCH,), generator=generator)]
        seen = _blown(rows[chosen[:, None] + place], middle, generator)
        target = seen[:, -1, :-1].clone()
        flags = hidden[torch.randint(len(hidden), (BATCH,), generator=generator)]
        answer = model(_inputs(_disturbed(seen, unit, generator), flags))
        loss = (torch.square(answer - target) * flags).sum() / flags.sum()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch has no type for it
        optimiser.step()
        schedule.step()
        progress(done + 1, batches)
    layers = [(layer.weight.detach().double().numpy(), layer.bias.detach().double().numpy()) for layer in linear]
    return EstimatorNetwork(window=window, mean=mean, std=std, layers=layers)


def _inputs(seen: Tensor, hidden: Tensor) -> Tensor:
    """Return the network's input, (B, L (S+1) + S), from windows (B, L, S+1) and flags (B, S) that hide sensors."""
    kept = torch.cat([1.0 - hidden, torch.ones(len(hidden), 1)], dim=1)
    return torch.cat([(seen * kept[:, None]).flatten(1), hidden], dim=1)


def _blown(seen: Tensor, middle: Tensor, generator: torch.Generator) -> Tensor:
    """Rescale windows as if the air's dynamic pressure differed from its value at the vehicle's speed."""
    share, is_blown = torch.rand(2, len(seen), 1, 1, generator=generator)
    factor = torch.square(1.0 + GUST * (2.0 * share - 1.0) * (is_blown < 0.5))
    return torch.cat([factor * (seen[:, :, :-1] + middle) - middle, seen[:, :, -1:]], dim=2)


def _disturbed(seen: Tensor, unit: Tensor, generator: torch.Generator) -> Tensor:
    batch, length, columns = seen.shape
    level = NOISE * torch.square(torch.rand(batch, 1, 1, generator=generator))
    readings = seen[:, :, :-1] + level * unit * torch.randn(batch, length, columns - 1, generator=generator)
    share = HELD * torch.rand(batch, 1, generator=generator) * torch.randint(2, (batch, 1), generator=generator)
    held = torch.rand(batch, length, generator=generator) < share
    held[:, 0] = held[:, -1] = False  # in a period without readings, the ECU makes no check
    source = torch.where(held, 0, torch.arange(length)).cummax(dim=1).values
    readings = torch.gather(readings, 1, source[:, :, None].expand(-1, -1, columns - 1))
    return torch.cat([readings, seen[:, :, -1:]], dim=2)
