"""The recorded episodes as standardised rows, and batches of contiguous rows for training.

Row k of an episode is the encoder's input at t_k: (Cp_k, a_{k-1}), one column per sensor and one for the action. Each
row also has the forces (Cd_k, Cl_k), and the input of the dynamics: a_k, the action commanded at t_k. A window that
ends at k consists of rows k-L+1 .. k; it never crosses an episode's boundary.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from contract.arrays import Array, Index
from contract.errors import ConfigError, DatasetError
from contract.recording.dataset import Episode
from contract.release.manifest import Scaling
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK


def fit_scaling(episodes: Sequence[Episode], layout: SensorLayout = TRUCK) -> Scaling:
    """Fit means and standard deviations to the episodes and, if the sensors have mirror images, also to the episodes'
    mirror images.

    The mirror image (y -> -y) permutes the sensors and changes the signs of action and lift. So the statistics with
    mirror images are symmetric, and mirroring commutes with scaling. The action is only divided by its rms. Raises
    DatasetError if a sensor, the action or a force is constant.
    """
    pressure = np.concatenate([episode.series["Cp"] for episode in episodes])
    action = np.concatenate([episode.series["action"] for episode in episodes])
    drag, lift = (np.concatenate([episode.series[name] for episode in episodes]) for name in ("Cd", "Cl"))
    # Mirror images are not checked, because they would add another sensor's values to a dead sensor's column.
    names = (*(f"sensor {name}" for name in layout.names), "action", "Cd", "Cl")
    for name, values in zip(names, (*pressure.T, action, drag, lift), strict=True):
        if np.ptp(values) == 0.0:
            raise DatasetError(f"{name} is constant at {values[0]:g} in all training episodes: nothing to learn from")
    mirror = np.arange(len(layout)) if layout.mirror is None else layout.mirror
    mean = pressure.mean(axis=0)
    mean = (mean + mean[mirror]) / 2
    variance = np.square(pressure - mean).mean(axis=0)
    std = np.sqrt((variance + variance[mirror]) / 2)
    mean_lift = float(lift.mean()) if layout.mirror is None else 0.0
    return Scaling(
        pressure_mean=tuple(mean.tolist()),
        pressure_std=tuple(std.tolist()),
        action_std=float(np.sqrt(np.square(action).mean())),
        force_mean=(float(drag.mean()), mean_lift),
        force_std=(float(drag.std()), float(np.sqrt(np.square(lift - mean_lift).mean()))),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """The standardised episodes, one after the other, in single precision: n rows and N sensors.

    Attributes:
        inputs, actions, forces: (n, N + 1) encoder rows, (n,) a_k, and (n, 2) Cd and Cl.
        lengths, names: number of rows and name of each episode, in order; the sum of the numbers is n.
        unit: (N,) rms of all sensors' standard deviations (paper, appendix B), divided by the sensor's deviation.
        layout: layout of the sensors, in the order of their columns.
    """

    inputs: Tensor
    actions: Tensor
    forces: Tensor
    lengths: tuple[int, ...]
    unit: Tensor
    layout: SensorLayout = TRUCK
    names: tuple[str, ...] = ()

    @property
    def sensors(self) -> int:
        """N, the number of sensors."""
        return self.inputs.shape[1] - 1

    def to(self, device: torch.device) -> "Rows":
        """Return the rows in the memory of `device`."""
        moved = {name: getattr(self, name).to(device) for name in ("inputs", "actions", "forces", "unit")}
        return replace(self, **moved)

    def spans(self) -> Iterator[slice]:
        """Yield the rows of each episode, as slices."""
        stop = 0
        for length in self.lengths:
            start, stop = stop, stop + length
            yield slice(start, stop)

    def first_rows(self, window: int) -> Index:
        """Return the index of the first row of every full window."""
        return np.concatenate([np.arange(span.start, span.stop - window + 1) for span in self.spans()])

    def windows_at(self, firsts: Index, window: int) -> Tensor:
        """Return the n windows that begin at the given n rows, (n, L, F)."""
        start = torch.as_tensor(firsts, device=self.inputs.device)
        return self.inputs[start[:, None] + torch.arange(window, device=start.device)]

    def with_sensors(self, chosen: Index) -> "Rows":
        """Return the rows with the columns of the chosen sensors, in the given order, and the action."""
        columns = torch.as_tensor(np.append(chosen, self.sensors), device=self.inputs.device)
        unit, layout = self.unit[columns[:-1]], self.layout.only(chosen)
        return replace(self, inputs=self.inputs[:, columns], unit=unit, layout=layout)

    def noise(self, level: float) -> Tensor:
        """Return the standard deviations (N,) of noise in the sensors' columns. `level` is the noise's deviation,
        divided by the rms of all sensors' standard deviations."""
        return level * self.unit


def prepare(episodes: Sequence[Episode], scaling: Scaling, *, mirrored: bool, layout: SensorLayout = TRUCK) -> Rows:
    """Return the standardised rows of the episodes and then, if `mirrored`, the rows of their mirror images. Raises
    ConfigError if `mirrored` is set and the layout has no mirror images."""
    mirror = layout.mirror
    if mirrored and mirror is None:
        raise ConfigError("mirrored rows: these sensors have no mirror images")
    pressure_mean, pressure_std = np.array(scaling.pressure_mean), np.array(scaling.pressure_std)
    force_mean, force_std = np.array(scaling.force_mean), np.array(scaling.force_std)
    global_deviation = np.sqrt(np.square(pressure_std).mean())  # (paper, appendix B)
    inputs, actions, forces = [], [], []
    for episode in episodes:
        pressure = (episode.series["Cp"] - pressure_mean) / pressure_std
        inputs.append(np.column_stack([pressure, episode.previous_action / scaling.action_std]))
        actions.append(episode.series["action"] / scaling.action_std)
        physical = np.column_stack([episode.series["Cd"], episode.series["Cl"]])
        forces.append((physical - force_mean) / force_std)
    names = tuple(episode.name for episode in episodes)
    if mirrored and mirror is not None:
        permutation = np.append(mirror, len(layout))
        sign = np.append(np.ones(len(layout)), -1.0)
        names += tuple(f"{name} (mirror image)" for name in names)
        inputs += [rows[:, permutation] * sign for rows in inputs]
        actions += [-rows for rows in actions]
        forces += [rows * (1.0, -1.0) for rows in forces]
    return Rows(
        inputs=_joined(inputs),
        actions=_joined(actions),
        forces=_joined(forces),
        lengths=tuple(len(rows) for rows in actions),
        unit=torch.from_numpy((global_deviation / pressure_std).astype(np.float32)),
        layout=layout,
        names=names,
    )


def _joined(parts: Sequence[Array]) -> Tensor:
    return torch.from_numpy(np.concatenate(parts).astype(np.float32))


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
    W = segment + ahead windows. Each pass covers every episode with segments from a random offset, in random order.
    Raises DatasetError if an episode is too short for one segment."""

    def __init__(self, rows: Rows, *, window: int, ahead: int, segment: int, batch_size: int, seed: int) -> None:
        self.rows, self.segment = rows, segment
        self._window, self._windows, self._seed = window, segment + ahead, seed
        needed = window - 1 + self._windows
        for number, length in enumerate(rows.lengths):
            if length < needed:
                raise DatasetError(
                    f"episode {rows.names[number]} has {length} steps, too short: a window of {window}, "
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
            # The first and the last segment are moved into the episode, so that every pass covers every sample.
            tiles = np.arange(-phase, last + self.segment, self.segment).clip(0, last)
            firsts.append(span.start + np.unique(tiles))
        return generator.permutation(np.concatenate(firsts))


def add_sensor_noise(batch: Batch, deviation: Tensor) -> Batch:
    """Add white noise with standard deviations (N,) to the N sensors of a batch, from torch's generator."""
    if not bool(deviation.any()):
        return batch
    noise = torch.randn(*batch.inputs.shape[:2], len(deviation), device=batch.inputs.device) * deviation
    return replace(batch, inputs=torch.cat([batch.inputs[..., :-1] + noise, batch.inputs[..., -1:]], dim=-1))
