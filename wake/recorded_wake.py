"""A plant that repeats the recorded pressures and forces of an episode, independent of the jets."""

from typing import Final

import numpy as np

from contract.arrays import Array
from contract.config.plant import FlowConfig
from contract.errors import PlantError
from contract.ledger import LEDGER_FIELDS
from contract.recording.episode import Episode
from contract.sensor_layout import SensorLayout
from wake.plant.protocol import SteppedPlant
from wake.plant.sample import Sample

_SAME_PERIOD: Final = 1e-6
"""Largest difference in t_c at which two control periods are treated as equal, because recorded times are rounded."""


class RecordedWake(SteppedPlant):
    """A `wake.plant.protocol.LoopPlant` that does not respond to the jets. After the episode's last row, the episode is
    repeated from its first row while the time goes on; `rounds` is the number of completed passes. A force that was not
    recorded is NaN. A sample has the action of the present run, not the recorded action. Raises PlantError if the
    episode and `flow` have different control periods."""

    answers_jets: Final = False

    def __init__(self, episode: Episode, layout: SensorLayout, flow: FlowConfig) -> None:
        t = episode.series["t"]
        if len(t) > 1 and abs(float(t[1] - t[0]) - flow.control_period) > _SAME_PERIOD:
            raise PlantError(
                f"episode {episode.name} has a row every {float(t[1] - t[0]):g} t_c, but flow.control_period is "
                f"{flow.control_period:g}"
            )
        self.layout = layout
        self.description = f"recorded episode {episode.name}, {len(episode)} periods: it does not respond to the jets"
        self._series, self._length, self.config = episode.series, len(episode), flow
        self._substep, self._action = 0, 0.0

    @property
    def _period(self) -> int:
        return self._substep // self.config.substeps

    @property
    def rounds(self) -> int:
        return self._period // self._length

    def sample(self) -> Sample:
        """Return the recorded row of the present period, with the time and the action of this run."""
        row = self._period % self._length
        return Sample(
            t=self.t,
            Cp=np.asarray(self._series["Cp"][row], dtype=np.float64),
            Uy_probe=self._value("Uy_probe", row),
            action=self._action,
            **{name: self._value(name, row) for name in LEDGER_FIELDS},
        )

    def advance_to(self, substep: int, action: float | None = None) -> None:
        """Advance as `Plant.advance_to` does. Raises PlantError for a substep of the past or of another period."""
        steps, _, self._action = self._ramp(substep, action)
        self._substep += steps

    def _checked(self, action: float) -> float:
        """Return the action unchecked, because the recording does not respond to it."""
        return action

    def _value(self, name: str, row: int) -> float:
        series: Array | None = self._series.get(name)
        return float("nan") if series is None else float(series[row])
