"""From recorded episodes to standardised rows, and the index of windows over them.

Row k of an episode is what the encoder sees at t_k: (Cp_k, a_{k-1}), 91 columns. A window ending at k is rows
k-31 .. k; it never crosses an episode's boundary. Beside the rows stand a_k, the action commanded at t_k that
the dynamics see, and the forces (Cd_k, Cl_k).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from contract import sensors
from contract.arrays import Array, Index
from contract.errors import ConfigError, DatasetError
from contract.recording.dataset import Episode
from contract.release.bundle import Scaling


def fit_scaling(episodes: Sequence[Episode]) -> Scaling:
    """Mean and standard deviation of the episodes taken together with their mirror images.

    The mirror image (y -> -y) permutes the sensors and turns the signs of action and lift. Statistics over both
    are symmetric: mean action and mean Cl are 0 and mirrored sensors share mean and deviation, so that mirroring
    commutes with scaling.

    Raises:
        DatasetError: if a sensor, the action or a force never changes; the message names it.
    """
    pressure = np.concatenate([episode.series["Cp"] for episode in episodes])
    action = np.concatenate([episode.series["action"] for episode in episodes])
    drag, lift = (np.concatenate([episode.series[name] for episode in episodes]) for name in ("Cd", "Cl"))
    # Before pooling: a dead sensor would hide behind its mirror image.
    for name, values in zip(sensors.NAMES, pressure.T, strict=True):
        _refuse_constant(f"sensor {name}", values)
    for name, values in (("action", action), ("Cd", drag), ("Cl", lift)):
        _refuse_constant(name, values)
    mirror = sensors.mirror_permutation()
    mean = pressure.mean(axis=0)
    mean = (mean + mean[mirror]) / 2
    variance = np.square(pressure - mean).mean(axis=0)
    std = np.sqrt((variance + variance[mirror]) / 2)
    return Scaling(
        pressure_mean=tuple(mean.tolist()),
        pressure_std=tuple(std.tolist()),
        action_std=float(np.sqrt(np.square(action).mean())),
        force_mean=(float(drag.mean()), 0.0),
        force_std=(float(drag.std()), float(np.sqrt(np.square(lift).mean()))),
    )


def global_deviation(scaling: Scaling) -> float:
    """Standard deviation of all 90 pressures taken together, in Cp, each about its own mean (paper, appendix B)."""
    return float(np.sqrt(np.square(scaling.pressure_std).mean()))


def unit_steps(scaling: Scaling, chosen: Index) -> Array:
    """(N,) one global deviation in each chosen sensor's standardised pressure."""
    steps: Array = global_deviation(scaling) / np.array(scaling.pressure_std)[chosen]
    return steps


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Standardised episodes, one after the other, single precision.

    Attributes:
        inputs: (n, 91) encoder rows.
        actions: (n,) a_k.
        forces: (n, 2) Cd, Cl.
        lengths: rows of each episode, in order; sums to n.
        unit: (90,) one global deviation of pressure in each sensor's column; None where the scaling is not known.
    """

    inputs: Tensor
    actions: Tensor
    forces: Tensor
    lengths: tuple[int, ...]
    unit: Tensor | None = None

    def to(self, device: torch.device) -> "Rows":
        """The same rows in the memory of `device`."""
        return replace(
            self,
            inputs=self.inputs.to(device),
            actions=self.actions.to(device),
            forces=self.forces.to(device),
            unit=None if self.unit is None else self.unit.to(device),
        )

    def spans(self) -> Iterator[slice]:
        """The rows of each episode."""
        stop = 0
        for length in self.lengths:
            start, stop = stop, stop + length
            yield slice(start, stop)

    def with_sensors(self, chosen: Index) -> "Rows":
        """Only the columns of the chosen sensors, in that order, and the action."""
        columns = torch.as_tensor(np.append(chosen, sensors.COUNT), device=self.inputs.device)
        return replace(
            self, inputs=self.inputs[:, columns], unit=None if self.unit is None else self.unit[columns[:-1]]
        )

    def noise(self, level: float) -> Tensor:
        """(N,) standard deviation of noise of `level` global deviations, in each sensor's column; zero at level 0.

        Raises:
            ConfigError: if the rows do not know what a global deviation is.
        """
        if self.unit is None:
            if level:
                raise ConfigError(f"sensor noise {level}: these rows were made without a scaling, so it has no unit")
            return self.inputs.new_zeros(self.inputs.shape[1] - 1)
        return level * self.unit


def prepare(episodes: Sequence[Episode], scaling: Scaling, *, mirrored: bool) -> Rows:
    """Standardised rows of the episodes, followed by those of their mirror images if `mirrored`."""
    pressure_mean, pressure_std = np.array(scaling.pressure_mean), np.array(scaling.pressure_std)
    force_mean, force_std = np.array(scaling.force_mean), np.array(scaling.force_std)
    inputs, actions, forces = [], [], []
    for episode in episodes:
        pressure = (episode.series["Cp"] - pressure_mean) / pressure_std
        inputs.append(np.column_stack([pressure, episode.previous_action / scaling.action_std]))
        actions.append(episode.series["action"] / scaling.action_std)
        physical = np.column_stack([episode.series["Cd"], episode.series["Cl"]])
        forces.append((physical - force_mean) / force_std)
    if mirrored:
        permutation = np.append(sensors.mirror_permutation(), sensors.COUNT)
        sign = np.append(np.ones(sensors.COUNT), -1.0)
        inputs += [rows[:, permutation] * sign for rows in inputs]
        actions += [-rows for rows in actions]
        forces += [rows * (1.0, -1.0) for rows in forces]
    return Rows(
        inputs=_joined(inputs),
        actions=_joined(actions),
        forces=_joined(forces),
        lengths=tuple(len(rows) for rows in actions),
        unit=torch.from_numpy(unit_steps(scaling, np.arange(sensors.COUNT)).astype(np.float32)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """S segments of rows and what belongs to the last W rows of each; W windows a segment.

    Attributes:
        inputs: (S, W + L - 1, F) encoder rows.
        actions: (S, W) a_k at the windows' ends.
        forces: (S, W, 2) forces at the windows' ends.
        ends: (S, W) indices of the windows' ends among all rows.
    """

    inputs: Tensor
    actions: Tensor
    forces: Tensor
    ends: Tensor


def noisy(batch: Batch, deviation: Tensor) -> Batch:
    """The batch with white noise of these deviations (N,) on its sensors, from torch's generator; as it is at zero."""
    if not bool(deviation.any()):
        return batch
    noise = torch.randn(*batch.inputs.shape[:2], len(deviation), device=batch.inputs.device) * deviation
    return replace(batch, inputs=torch.cat([batch.inputs[..., :-1] + noise, batch.inputs[..., -1:]], dim=-1))


class SegmentSampler:
    """Batches of contiguous segments; the batch of a step depends on the seed and the step alone.

    A sample is a window and the `ahead` windows that follow it. Segments hold `segment` consecutive samples, so
    one segment has W = segment + ahead windows. Each pass tiles every episode with segments from a random
    phase and shuffles them.
    """

    def __init__(self, rows: Rows, *, window: int, ahead: int, segment: int, batch_size: int, seed: int) -> None:
        """Raises DatasetError if an episode is too short to hold one segment."""
        self.rows = rows
        self.segment = segment
        self._window, self._windows, self._seed = window, segment + ahead, seed
        needed = window - 1 + self._windows
        for number, length in enumerate(rows.lengths):
            if length < needed:
                raise DatasetError(
                    f"episode {number} has {length} steps, too short: a window of {window}, {ahead} steps ahead "
                    f"and segments of {segment} need {needed}"
                )
        self.samples = sum(length - needed + segment for length in rows.lengths)
        self._segments = max(1, batch_size // segment)
        self._batches = -(-self.samples // (self._segments * segment))
        self._cached: tuple[int, Index] = (-1, np.empty(0, dtype=np.intp))

    def steps(self, epochs: float) -> int:
        """Batches in that many passes over all samples, at least 1."""
        return max(1, round(epochs * self.samples / (self._segments * self.segment)))

    def first_rows(self, step: int) -> Index:
        """(S,) index of the first row of each segment of that batch."""
        epoch, position = divmod(step, self._batches)
        if self._cached[0] != epoch:
            self._cached = (epoch, self._shuffled(epoch))
        order = self._cached[1]
        wanted = np.arange(position * self._segments, (position + 1) * self._segments)
        return order[wanted % len(order)]

    def batch(self, step: int) -> Batch:
        """The batch of that step."""
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
            # Both ends are clipped inward, so that every sample is covered in every pass.
            tiles = np.arange(-phase, last + self.segment, self.segment).clip(0, last)
            firsts.append(span.start + np.unique(tiles))
        return generator.permutation(np.concatenate(firsts))


def _joined(parts: Sequence[Array]) -> Tensor:
    return torch.from_numpy(np.concatenate(parts).astype(np.float32))


def _refuse_constant(name: str, values: Array) -> None:
    if np.ptp(values) == 0.0:
        raise DatasetError(f"{name} is constant at {values[0]:g} in all training episodes: nothing to learn from")
