"""The flow as the live page shows it; nothing of a plant that has none to be shown."""

from typing import cast

from firmware_sim.live.loop.messages import FieldPicture
from wake.pictures.level_picture import LevelPicture
from wake.plant.protocol import LivePlant, LoopPlant


class ShownFlow:
    """The scene of a plant whose flow can be drawn."""

    def __init__(self, wake: LivePlant) -> None:
        self._wake = wake
        self._picture = LevelPicture(wake)
        self.view, self.size = self._picture.view, self._picture.size

    def look(self, k: int) -> FieldPicture:
        """The flow at the start of period k; to be asked once a period."""
        return FieldPicture(k=k, t=self._wake.t, levels=self._picture.levels())


class NoFlow:
    """The scene of a plant that has pressures and forces alone."""

    view: tuple[float, ...] = ()
    size: tuple[int, ...] = ()

    def look(self, k: int) -> None:
        """Nothing."""


def scene_of(wake: LoopPlant) -> ShownFlow | NoFlow:
    """What can be shown of a plant."""
    return ShownFlow(cast(LivePlant, wake)) if hasattr(wake, "vorticity") else NoFlow()
