"""Sources of pressures in real time: the interface that the loop uses, and the replay of a recording."""

from typing import Protocol

import numpy as np

from contract.arrays import Array
from contract.errors import DatasetError
from contract.recording.dataset import Dataset
from contract.sensor_layout import SensorLayout


class Pressures(Protocol):
    """A source of pressures in real time; its `description` states whether the pressures respond to the jets."""

    layout: SensorLayout
    description: str

    def sampled(self) -> Array | None:
        """Return Cp, shape (sensors,), at the present sampling instant; None if the flow has not reached it yet."""

    def drive(self, action: float) -> None:
        """Ramp the jets to `action`, in U_inf W, from this sampling instant to the next."""


class Replay:
    """Recorded pressures, one row per period. They do not respond to the jets. Raises DatasetError if the episode does
    not exist. `rounds` counts the restarts of the recording; at each restart the pressures jump.

    Args:
        episode: name of the episode; if None, the first episode without a controller, preferably without jets.
    """

    def __init__(self, dataset: Dataset, episode: str | None = None) -> None:
        known = {item.name: item for item in dataset.episodes}
        if episode is None:
            chosen = min(known.values(), key=lambda one: (one.role == "controlled", bool(one.series["action"].any())))
        elif episode in known:
            chosen = known[episode]
        else:
            raise DatasetError(f"episode {episode!r}: the data set has {', '.join(known)}")
        self.layout, self._cp = dataset.layout, chosen.series["Cp"]
        self.description = (
            f"open loop: recorded episode {chosen.name}, {len(chosen)} periods; the pressures do not respond to the "
            "jets, and an ECU in control may find them IMPLAUSIBLE or NOT_HELPING"
        )
        self._next = 0
        self.rounds = 0

    def sampled(self) -> Array:
        """Return the recorded row of this period; the first row follows the last row."""
        if self._next == len(self._cp):
            self._next = 0
            self.rounds += 1
        row = np.asarray(self._cp[self._next], dtype=np.float64)
        self._next += 1
        return row

    def drive(self, action: float) -> None:
        """Ignore the action: a recording does not respond."""
