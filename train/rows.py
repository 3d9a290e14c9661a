"""Recorded episodes as standardised rows.

Row k of an episode is the encoder's input at t_k: (Cp_k, a_{k-1}), 91 columns. With it stand a_k, the action commanded
at t_k that the dynamics take, and the forces (Cd_k, Cl_k). A window ending at k is rows k-31 .. k; it never crosses an
episode's boundary.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from contract import sensors
from contract.arrays import Array, Index
from contract.errors import ConfigError
from contract.recording.dataset import Episode
from contract.release.manifest import Scaling
from train.scaling import unit_steps


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
            ConfigError: if these rows have no global deviation.
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


def _joined(parts: Sequence[Array]) -> Tensor:
    return torch.from_numpy(np.concatenate(parts).astype(np.float32))
