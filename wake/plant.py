"""What a closed loop needs of a flow."""

from typing import Protocol

from wake.truck.truck_wake import Sample


class Plant(Protocol):
    """What the loop needs of a flow."""

    def sample(self) -> Sample:
        """Measure now."""

    def advance_to(self, substep: int, action: float | None = None) -> None:
        """Advance within the control period; with an action, ramp so as to reach it at the period's end."""
