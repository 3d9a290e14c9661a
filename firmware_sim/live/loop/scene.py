"""The flow as the live page shows it and a saved run keeps it; nothing of a plant that has none to be shown."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from matplotlib.figure import Figure

from contract.arrays import Array
from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.sensor_layout import SensorLayout
from firmware_sim.live.loop.messages import FieldPicture
from firmware_sim.runs.wake_stills import Scene, WakeRecorder, WakeStills
from wake.pictures.drawing import vorticity_figure
from wake.pictures.level_picture import LevelPicture
from wake.plant.protocol import LivePlant, LoopPlant
from wake.plant.sample import Sample
from wake.solver.grid import Grid


@dataclass(frozen=True, kw_only=True, eq=False)
class Still:
    """A flow as it was at an instant; a `wake.plant.protocol.Drawable`."""

    grid: Grid
    config: FlowConfig
    body: BodyConfig
    layout: SensorLayout
    t: float
    sampled: Sample
    w: Array

    def sample(self) -> Sample:
        """As measured then."""
        return self.sampled

    def vorticity(self) -> Array:
        """As it was."""
        return self.w

    def pressure(self) -> None:
        """Not kept."""


class ShownFlow:
    """The scene of a plant whose flow can be drawn.

    Args:
        wake: the plant.
        kept: periods.
    """

    def __init__(self, wake: LivePlant, kept: int) -> None:
        self._wake = wake
        self._picture = LevelPicture(wake)
        self._recorder = WakeRecorder(Scene.of(self._picture, wake.layout), kept)
        self.view, self.size = self._picture.view, self._picture.size

    def look(self, k: int) -> FieldPicture:
        """The flow at the start of period k; to be asked once a period."""
        levels = self._picture.levels()
        self._recorder.record(k, self._wake.t, lambda: levels)
        return FieldPicture(k=k, t=self._wake.t, levels=levels)

    def still(self) -> Still:
        """The flow now, to be drawn later."""
        wake = self._wake
        return Still(
            grid=wake.grid,
            config=wake.config,
            body=wake.body,
            layout=wake.layout,
            t=wake.t,
            sampled=wake.sample(),
            w=wake.vorticity().copy(),
        )

    def recorded(self, first: int) -> WakeStills | None:
        """What was kept from period `first` on; None of fewer periods than two stills are apart."""
        stills = self._recorder.recorded(first)
        return stills if stills.stills else None


class NoFlow:
    """The scene of a plant that has pressures and forces alone."""

    view: tuple[float, ...] = ()
    size: tuple[int, ...] = ()

    def look(self, k: int) -> None:
        """Nothing."""

    def still(self) -> None:
        """Nothing."""

    def recorded(self, first: int) -> None:
        """Nothing."""


def scene_of(wake: LoopPlant, kept: int) -> ShownFlow | NoFlow:
    """What can be shown of a plant; `kept` periods are remembered."""
    if not hasattr(wake, "vorticity"):
        return NoFlow()
    return ShownFlow(cast(LivePlant, wake), kept)


def draw(still: Still | None, sensors: tuple[str, ...], state: str, target: Path) -> None:
    """The vorticity as PNG, or a picture that notes that there is none."""
    if still is not None:
        figure = vorticity_figure(still, sensors, title=f"{state}, t = {still.t:.1f} $t_c$")
    else:
        figure = Figure(figsize=(10.0, 3.1))
        centred: Any = {"ha": "center", "va": "center", "fontsize": 14}
        figure.text(0.5, 0.5, f"{state}: this plant has no flow to be shown", **centred)
    figure.savefig(target, format="png")
