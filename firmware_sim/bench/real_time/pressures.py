"""Where the pressures come from: what the loop asks of a flow, and a recording that is played again."""

from typing import Protocol

import numpy as np

from contract.arrays import Array
from contract.errors import DatasetError
from contract.recording.dataset import Dataset
from contract.recording.episode import Episode
from contract.sensor_layout import SensorLayout


class Pressures(Protocol):
    """A flow that goes on in real time; `description` is a few words, with whether it answers the jets."""

    layout: SensorLayout
    description: str

    def sampled(self) -> Array | None:
        """Cp at the sampling instant that has come, (sensors,); None if the flow has not got there yet."""

    def drive(self, action: float) -> None:
        """Let the jets ramp from this sampling instant to `action`, U_inf W, at the next one."""


class Replay:
    """Recorded pressures, one row a period. They do not answer the jets. Raises DatasetError if there is no such
    episode.

    Args:
        episode: its name; if None the first without a controller, before others one with the jets at rest.

    Attributes:
        layout, description: of the recording; see `Pressures`.
        rounds: how often the recording began again; the pressures jump then.
    """

    def __init__(self, dataset: Dataset, episode: str | None = None) -> None:
        chosen = _episode(dataset, episode)
        self.layout, self._cp = dataset.layout, chosen.series["Cp"]
        self.description = (
            f"open loop: recorded episode {chosen.name}, {len(chosen)} periods; the pressures do not answer the jets, "
            "and an ECU in control may find them IMPLAUSIBLE or NOT_HELPING"
        )
        self._next = 0
        self.rounds = 0

    def sampled(self) -> Array:
        """The row of this period; after the last one the first."""
        if self._next == len(self._cp):
            self._next = 0
            self.rounds += 1
        row = np.asarray(self._cp[self._next], dtype=np.float64)
        self._next += 1
        return row

    def drive(self, action: float) -> None:
        """Nothing: what is recorded has happened."""


def _episode(dataset: Dataset, name: str | None) -> Episode:
    if name is None:
        return min(dataset.episodes, key=lambda one: (one.role == "controlled", bool(one.series["action"].any())))
    for item in dataset.episodes:
        if item.name == name:
            return item
    raise DatasetError(f"episode {name!r}: the data set has {', '.join(item.name for item in dataset.episodes)}")
