"""A film of a run: vorticity on a dark background, the jets, the sensors, and drag and action up to the present.

    python -m examples.film_of_a_run runs/demo film.webp

Scales, and positions and sizes of texts, are the same in all frames, so that they do not distract from the flow. The
film is for a README: a few words show when control begins and how much control reduces the drag.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import typer
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from contract.arrays import Array
from contract.config.loading import load_config
from contract.errors import ConfigError, StillwakeError
from firmware_sim.runs.run_log import RunFolder, RunLog, load
from wake.pictures.drawing import animate, check_target, jet_arrow, outline
from wake.pictures.fields import Raster, View
from wake.plant.protocol import LivePlant
from wake.truck.state import developed_state
from wake.truck.truck_wake import TruckWake

NIGHT: Final = "#0a0d14"
"""Colour of the background."""
PALE: Final = "#e8edf5"
DIM: Final = "#8a94a6"
FAINT: Final = "#232a38"
CALM: Final = "#4fe3a1"
"""Colour of the border, the drag and the texts while control is on."""
BLOWING: Final = "#ffd23f"
SUCKING: Final = "#c792ff"
GLOW: Final = LinearSegmentedColormap.from_list(
    "glow",
    [
        (0.00, "#d4fcff"), (0.12, "#46c9ff"), (0.28, "#1a6bd0"), (0.41, "#0e2a58"), (0.49, NIGHT),
        (0.51, NIGHT), (0.59, "#541a18"), (0.72, "#cf3f20"), (0.88, "#ffa040"), (1.00, "#fff6cf"),
    ],
)  # fmt: skip
"""Colour map of the vorticity, from blue through the background colour to red: fluid without vorticity is dark."""

VIEW: Final[View] = (4.6, 19.6, -2.15, 2.15)
_LEVEL: Final = 5.0  # |vorticity| at the ends of the colour map, in U_inf / W
_ROOT: Final = 0.75
"""Exponent of |vorticity| / `_LEVEL` before colouring. An exponent below 1 makes weak vortices visible downstream."""
_ARROW: Final = 1.8  # length in W of the arrow of a jet at the action's bound
_DPI: Final = 100.0
_HEIGHT: Final = 0.5  # height of the picture divided by its width
BEFORE: Final = 11.0  # time in t_c that a film shows before control begins: about two shedding cycles
AFTER: Final = 50.0  # longest time in t_c that a film shows under control
HOLD: Final = 2.5  # additional time in s for which a film shows the last frame
_MINUS: Final = "\N{MINUS SIGN}"
_CYCLE: Final = 5.0  # shedding period of the uncontrolled wake, in t_c
_FLASH: Final = 2.5  # time in t_c during which the flow's coloured border fades out after control begins


@dataclass(frozen=True, kw_only=True)
class Story:
    """The first and the last time that a film shows and the time at which control begins, in t_c, and the mean wall Cd
    without control, to which the film relates the drag."""

    begin: float
    end: float
    control: float
    drag_before: float


class Film:
    """A dark figure that shows the present state of a plant, and drag and action up to the present. Call `record` in
    every control period, even if no frame is drawn. The controller's sensors are bright dots, all other sensors small
    dots. `width` is in pixels; width and height must be even."""

    def __init__(self, wake: LivePlant, story: Story, sensor_names: Sequence[str], width: int = 960) -> None:
        self._wake, self._story = wake, story
        self._times: list[float] = []
        self._drag: list[float] = []
        self._action: list[float] = []
        height = 2 * round(0.5 * _HEIGHT * width)
        self.figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI, facecolor=NIGHT)
        FigureCanvasAgg(self.figure)
        # The sizes of texts and lines are proportional to the picture's width.
        self._pt = 72.0 / _DPI * width / 960.0
        share = (VIEW[3] - VIEW[2]) / (VIEW[1] - VIEW[0]) / _HEIGHT
        flow = self.figure.add_axes((0.0, 1.0 - share, 1.0, share), xlim=VIEW[:2], ylim=VIEW[2:])
        flow.set_axis_off()
        self._raster = Raster(wake.grid.xf[1:-1], wake.grid.yf[1:-1], VIEW, width)
        self._image = flow.imshow(
            np.zeros((len(self._raster.y), width)), cmap=GLOW, vmin=-1.0, vmax=1.0, extent=VIEW, origin="lower",
            aspect="auto", interpolation="nearest",
        )  # fmt: skip
        self._frame = flow.plot(
            [VIEW[0], VIEW[1], VIEW[1], VIEW[0], VIEW[0]], [VIEW[2], VIEW[2], VIEW[3], VIEW[3], VIEW[2]],
            color=CALM, linewidth=8.0 * self._pt, alpha=0.0,
        )[0]  # fmt: skip
        self._draw_truck(flow, wake, sensor_names)
        self._jets = [(side, *self._jet(flow, side)) for side in (1, -1)]
        self._texts = self._headline(flow, len(sensor_names))
        self._traces = self._draw_traces(1.0 - share)

    def record(self) -> None:
        """Store the plant's present drag and action."""
        sample = self._wake.sample()
        self._times.append(sample.t)
        self._drag.append(sample.Cd)
        self._action.append(sample.action / self._wake.config.action_limit)

    def update(self) -> Figure:
        """Draw the plant's present state in the figure."""
        sample = self._wake.sample()
        field = self._raster(np.asarray(self._wake.vorticity())) / _LEVEL
        self._image.set_data(np.sign(field) * np.minimum(np.abs(field), 1.0) ** _ROOT)
        for side, arrow, halo in self._jets:
            share = side * sample.action / self._wake.config.action_limit
            for patch in (arrow, halo):
                patch.set_xy(jet_arrow(_ARROW * share, side, self._wake.body.length))
                patch.set_color(BLOWING if share > 0 else SUCKING)
                patch.set_visible(abs(share) > 0.01)
        since = sample.t - self._story.control
        self._frame.set_alpha(max(0.0, 1.0 - since / _FLASH) if since >= 0.0 else 0.0)
        self._tell(sample.t, sample.Cd)
        return self.figure

    def pixels(self) -> npt.NDArray[np.uint8]:
        """Draw the present state as RGB pixels, (height, width, 3)."""
        self.update()
        canvas: Any = self.figure.canvas
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    @staticmethod
    def palette() -> Array:
        """Return the film's colours for a GIF, (n, 3) with n <= 256, from 0 to 1."""
        scales = [GLOW(np.linspace(0.0, 1.0, 176))[:, :3]]
        for colour, count in ((PALE, 20), (CALM, 20), (BLOWING, 10), (SUCKING, 10), (DIM, 10), (FAINT, 5)):
            share = np.linspace(0.0, 1.0, count + 1)[1:, None]
            dark, full = (np.array(mpl.colors.to_rgb(one)) for one in (NIGHT, colour))
            scales.append((1.0 - share) * dark + share * full)
        return np.vstack(scales)

    def _draw_truck(self, axes: Axes, wake: LivePlant, names: Sequence[str]) -> None:
        colours = {"facecolor": "#161c28", "edgecolor": "#5b6679"}
        axes.add_patch(Polygon(outline(wake.body), closed=True, **colours, linewidth=1.4 * self._pt, zorder=3))
        places = wake.layout.positions
        axes.plot(*places.T, ".", color="#5b6679", markersize=3.0 * self._pt, zorder=4)
        lit = places[wake.layout.indices(names)]
        for size, alpha in ((26.0, 0.12), (17.0, 0.25), (8.5, 1.0)):
            axes.plot(
                *lit.T, "o", color="#7df9ff", markersize=size * self._pt, alpha=alpha, markeredgewidth=0.0, zorder=5
            )

    def _jet(self, axes: Axes, side: int) -> tuple[Polygon, Polygon]:
        points = jet_arrow(0.5, side, self._wake.body.length)
        arrow = Polygon(points, closed=True, linewidth=1.0 * self._pt, zorder=7, joinstyle="round")
        halo = Polygon(points, closed=True, linewidth=9.0 * self._pt, alpha=0.22, zorder=6, joinstyle="round")
        for patch in (halo, arrow):
            axes.add_patch(patch)
        return arrow, halo

    def _headline(self, axes: Axes, sensors: int) -> dict[str, Any]:
        counted = f"{sensors} wall-pressure sensor{'s' * (sensors != 1)}"

        def text(x: float, y: float, words: str, size: float, colour: str, **more: Any) -> Any:
            more |= {"transform": axes.transAxes, "color": colour, "fontsize": size * self._pt, "zorder": 9}
            return axes.text(x, y, words, **more)

        return {
            "state": text(0.022, 0.93, "", 21.0, PALE, weight="bold", va="top"),
            "clock": text(0.978, 0.93, "", 15.0, DIM, va="top", ha="right", family="monospace"),
            "sensors": text(0.022, 0.07, counted, 13.0, "#7df9ff", va="bottom"),
        }

    def _draw_traces(self, top: float) -> dict[str, Any]:
        story = self._story
        left, width = 0.085, 0.67
        drag = self.figure.add_axes((left, 0.36 * top, width, 0.60 * top), facecolor=NIGHT)
        action = self.figure.add_axes((left, 0.06 * top, width, 0.25 * top), facecolor=NIGHT)
        found: dict[str, Any] = {}
        for axes, limits, ticks, label in (
            (drag, (0.64, 1.12), (0.8, 1.0), "drag $C_d$"),
            (action, (-1.15, 1.15), (), "jets"),
        ):
            axes.set(xlim=(story.begin, story.end), ylim=limits, xticks=(), yticks=ticks)
            axes.tick_params(colors=DIM, labelsize=12.0 * self._pt, length=0.0)
            for edge in axes.spines.values():
                edge.set_visible(False)
            axes.axhline(story.drag_before if axes is drag else 0.0, color=FAINT, linewidth=1.5 * self._pt, zorder=1)
            axes.axvline(story.control, color=CALM, linewidth=1.2 * self._pt, alpha=0.55, zorder=1)
            axes.text(
                -0.012, 1.0 if axes is drag else 0.5, label, transform=axes.transAxes, color=PALE,
                fontsize=13.0 * self._pt, ha="right", va="top" if axes is drag else "center",
            )  # fmt: skip
        for name, axes, colour in (("before", drag, PALE), ("under", drag, CALM), ("action", action, BLOWING)):
            found[name] = axes.plot([], [], color=colour, linewidth=2.0 * self._pt, solid_capstyle="round", zorder=3)[0]
        found["head"] = drag.plot([], [], "o", color=PALE, markersize=7.0 * self._pt, zorder=4, clip_on=False)[0]
        found["number"] = self.figure.text(
            0.972, 0.62 * top, "", color=CALM, fontsize=46.0 * self._pt, weight="bold", ha="right", va="center"
        )
        found["unit"] = self.figure.text(
            0.972, 0.32 * top, "", color=DIM, fontsize=15.0 * self._pt, ha="right", va="center"
        )
        return found

    def _tell(self, now: float, drag: float) -> None:
        story, traces, texts = self._story, self._traces, self._texts
        under = now >= story.control
        texts["state"].set_text("CONTROL ON" if under else "CONTROL OFF")
        texts["state"].set_color(CALM if under else PALE)
        texts["clock"].set_text(f"t = {now - story.control:+5.1f} W/U∞")
        times, drags = np.array(self._times), np.array(self._drag)
        for name, part in (("before", times <= story.control), ("under", times >= story.control)):
            traces[name].set_data(times[part], drags[part])
        traces["action"].set_data(times, self._action)
        traces["head"].set_data([now], [drag])
        traces["head"].set_color(CALM if under else PALE)
        # The mean covers a whole shedding cycle, because the drag oscillates twice in each cycle.
        lately = drags[(times > now - _CYCLE) & (times >= story.control)]
        is_known = len(lately) > 0 and now - story.control >= _CYCLE
        change = 100.0 * (lately.mean() / story.drag_before - 1.0) if is_known else 0.0
        traces["number"].set_text(f"{change:+.0f} %".replace("-", _MINUS) if is_known else "")
        traces["unit"].set_text("drag, over the last cycle" if is_known else "")


def story_of(log: RunLog, begin: float | None = None, end: float | None = None) -> Story:
    """Return the story from `BEFORE` to `AFTER` around the beginning of control, or from `begin` to `end`, in t_c.
    Raises ConfigError if the run has no time before control, or the film would not show the beginning of control."""
    t, first = log.series["t"], log.enabled_at
    if not 0 < first < len(t):
        raise ConfigError("film: the run must begin without control and continue with control")
    control = float(t[first])
    story = Story(
        begin=max(0.0, control - BEFORE) if begin is None else begin,
        end=min(float(t[-1]), control + AFTER) if end is None else end,
        control=control,
        drag_before=float(log.series["Cd"][:first].mean()),
    )
    if not story.begin < control < story.end:
        raise ConfigError(
            f"film: {story.begin:g} to {story.end:g} t_c does not show the beginning of control at {control:g} t_c"
        )
    return story


def write_film(path: Path, log: RunLog, story: Story, width: int = 960) -> int:
    """Repeat the simulation of a run from the shipped start, write a film of it, and return the number of frames.
    Raises ConfigError if the extension of the film's file name is unknown."""
    config = load_config()
    wake = TruckWake(config.flow)
    wake.reset(developed_state())
    period = config.flow.control_period
    # Row k of the run's series has the action that the jets have reached at time t_k.
    actions = log.series["action"][1 : round(story.end / period) + 1]
    film = Film(wake, story, log.metadata.sensors, width)
    return animate(path, film, wake, actions, skip=round(story.begin / period), every=2, fps=20, hold=HOLD)


def main(
    run: Annotated[Path, typer.Argument(help="Folder written by `stillwake run`.")],
    output: Annotated[Path, typer.Argument(help="Film to write: .webp or .gif.")],
    begin: Annotated[float | None, typer.Option(help="First time in t_c; default: 11 before control.")] = None,
    end: Annotated[float | None, typer.Option(help="Last time in t_c; default: 50 after control.")] = None,
    width: Annotated[int, typer.Option(help="Width in pixels.", min=400, max=4000)] = 960,
) -> None:
    """Write the film of a run under control."""
    try:
        check_target(output)
        log = load(RunFolder(run).series)
        frames = write_film(output, log, story_of(log, begin, end), width)
    except StillwakeError as error:
        sys.exit(f"error: {error}")
    typer.echo(f"wrote {output}: {frames} frames")


if __name__ == "__main__":
    typer.run(main)
