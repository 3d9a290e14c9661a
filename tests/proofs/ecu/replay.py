"""A plant that shows recorded samples for ever: forward, backward, and again, so that no pressure jumps."""

from collections.abc import Mapping

from contract.arrays import Array
from wake.plant.sample import Sample

_MEASURED = ("Cd", "Cl", "Cd_slot_pressure", "Cd_slot_viscous", "Cd_momentum", "jet_power", "Uy_probe")


class ReplayedPlant:
    """What the loop needs of a flow (`wake.plant.protocol.Plant`); the jets change nothing in it.

    Args:
        series: of an episode of the recording, at least two rows long.
        control_period: t_c between two rows.

    Attributes:
        periods: control periods advanced.
    """

    def __init__(self, series: Mapping[str, Array], control_period: float) -> None:
        self._series, self._control_period = series, control_period
        self._action, self.periods = 0.0, 0

    def sample(self) -> Sample:
        """The row of this period; time goes on, and the action is the one reached."""
        again = 2 * len(self._series["t"]) - 2
        row = min(self.periods % again, again - self.periods % again)
        measured = {name: float(self._series[name][row]) for name in _MEASURED}
        t, cp = self.periods * self._control_period, self._series["Cp"][row]
        return Sample(t=t, Cp=cp, action=self._action, **measured)

    def advance_to(self, substep: int, action: float | None = None) -> None:
        """See `wake.plant.protocol.Plant`: with an action, to the period's end."""
        if action is not None:
            self._action, self.periods = action, self.periods + 1
