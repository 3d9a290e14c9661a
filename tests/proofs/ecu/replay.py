"""A plant that shows recorded samples for ever: forward, backward, and again, so that no pressure jumps."""

from contract.arrays import Array
from contract.recording.episode import Episode
from wake.plant.sample import Sample


class ReplayedPlant:
    """What the loop needs of a flow (`wake.plant.protocol.Plant`); the jets change nothing in it.

    Args:
        episode: of the recording, at least two rows long.
        control_period: t_c between two rows.

    Attributes:
        periods: control periods advanced.
    """

    def __init__(self, episode: Episode, control_period: float) -> None:
        self._series: dict[str, Array] = dict(episode.series)
        self._rows = len(self._series["t"])
        self._control_period = control_period
        self._action = 0.0
        self.periods = 0

    def sample(self) -> Sample:
        """The row of this period; time goes on, and the action is the one reached."""
        place = self.periods % (2 * self._rows - 2)
        row = min(place, 2 * self._rows - 2 - place)
        measured = {name: float(self._series[name][row]) for name in _MEASURED}
        return Sample(
            t=self.periods * self._control_period, Cp=self._series["Cp"][row], action=self._action, **measured
        )

    def advance_to(self, substep: int, action: float | None = None) -> None:
        """See `wake.plant.protocol.Plant`: with an action, to the period's end."""
        del substep
        if action is not None:
            self._action = action
            self.periods += 1


_MEASURED = ("Cd", "Cl", "Cd_slot_pressure", "Cd_slot_viscous", "Cd_momentum", "jet_power", "Uy_probe")
