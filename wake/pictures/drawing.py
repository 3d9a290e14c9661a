"""The pictures of the flow around a body, with jets and sensors, and their animations as GIF or WebP files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, Literal, Protocol

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Polygon
from matplotlib.ticker import MultipleLocator
from PIL import Image

from contract.arrays import Array
from contract.atomic import replacing
from contract.config.body import BodyConfig
from contract.errors import ConfigError
from contract.geometry import HALF_WIDTH, JET_WIDTH
from wake.pictures.fields import Raster, View, velocity
from wake.plant.protocol import LivePlant
from wake.solver.grid import Flow, Grid
from wake.truck.develop import recirculation_length
from wake.truck.truck_wake import TruckWake

Kind = Literal["vorticity", "pressure"]

VIEW: Final[View] = (-1.5, 20.0, -3.0, 3.0)
_NEAR_WAKE: Final = (-0.847, 4.353, -1.2, 1.2)
"""Limits in x and y of the near-wake picture, in W; x is measured from the base."""
FIELD_COLOURS: Final = "RdBu_r"
"""Name of the colour map of the field. The map is diverging and symmetric about zero."""
SENSOR_COLOURS: Final = "viridis"
BLOWING: Final = "#ff7f0e"
SUCKING: Final = "#8e44ad"
SENSOR_RANGE: Final = (-0.9, 0.1)
"""Ends of the colour scale for wall Cp. The Cp of the uncontrolled truck's sensors lies in this range."""
_LEVEL: Final[dict[Kind, float]] = {"vorticity": 4.0, "pressure": 1.0}
_LABEL: Final[dict[Kind, str]] = {
    "vorticity": r"vorticity  $\omega_z W / U_\infty$",
    "pressure": "$C_p$, also at the sensors",
}
_FULL_JET: Final = 1.0
"""Length in W of the arrow of a jet at the action's bound."""
PICTURES: Final = (".png", ".pdf", ".svg")


class WakePicture:
    """A figure of fixed size, `width` pixels wide, that shows the present state of a plant and can be updated: the
    vorticity or Cp in colour, the body, arrows for the jets, and the sensors. The sensors of `sensor_names` are
    coloured by their Cp (None means all); other sensors are small dots. The colour scales are fixed."""

    def __init__(
        self, wake: LivePlant, kind: Kind = "vorticity", sensor_names: Sequence[str] | None = None, width: int = 1100
    ) -> None:
        self._wake = wake
        self._kind: Kind = kind
        if kind == "pressure" and wake.pressure() is None:
            raise ConfigError("the pressure in the flow can be drawn only with stillwake's solver")
        layout = wake.layout
        self._chosen = layout.indices(layout.names if sensor_names is None else sensor_names)
        grid, level = wake.grid, _LEVEL[kind]
        nodes = (grid.xf[1:-1], grid.yf[1:-1]) if kind == "vorticity" else (grid.xc, grid.yc)
        self._raster = Raster(*nodes, VIEW, width)
        colours, limits = (FIELD_COLOURS, (-level, level)) if kind == "pressure" else (SENSOR_COLOURS, SENSOR_RANGE)
        dots = 4.0 if len(self._chosen) > len(layout) // 2 else 6.0
        self.figure, axes = _figure(10.0, 3.1, width / 10.0, VIEW)
        self._image = axes.imshow(
            np.zeros((len(self._raster.y), width)), cmap=FIELD_COLOURS, vmin=-level, vmax=level, extent=VIEW,
            origin="lower", interpolation="bilinear",
        )  # fmt: skip
        _add_body(axes, wake.body)
        places = layout.positions
        axes.plot(*places.T, ".", color="0.35", markersize=1.5, zorder=4)
        self._dots = axes.scatter(
            places[self._chosen, 0], places[self._chosen, 1], c=np.zeros(len(self._chosen)), s=dots**2, cmap=colours,
            norm=Normalize(*limits), edgecolors="black", linewidths=0.4, zorder=5, clip_on=False,
        )  # fmt: skip
        edge: Any = {"edgecolor": "black", "linewidth": 0.5, "zorder": 6}
        self._jets = {side: Polygon(jet_arrow(0.0, side, wake.body.length), **edge) for side in (1, -1)}
        for arrow in self._jets.values():
            axes.add_patch(arrow)
        self._title = axes.set_title(" ", family="monospace", loc="left")
        bars: Any = {"ax": axes, "fraction": 0.02, "pad": 0.012, "extend": "both"}
        if kind == "vorticity":
            self.figure.colorbar(self._dots, label="$C_p$ at the sensors", **bars)
        self.figure.colorbar(self._image, label=_LABEL[kind], **bars)

    def update(self, title: str | None = None) -> Figure:
        """Show the plant's present state. If `title` is None, the title states time, wall drag and action."""
        sample = self._wake.sample()
        field = self._wake.vorticity() if self._kind == "vorticity" else self._wake.pressure()
        self._image.set_data(self._raster(np.asarray(field)))
        self._dots.set_array(sample.Cp[self._chosen])
        for side, arrow in self._jets.items():
            share = side * sample.action / self._wake.config.action_limit
            arrow.set_xy(jet_arrow(share, side, self._wake.body.length))
            arrow.set_facecolor(BLOWING if share > 0 else SUCKING)
            arrow.set_visible(abs(share) > 1e-3)
        numbers = f"t = {sample.t:.1f} W/U∞".ljust(18) + f"Cd = {sample.Cd:.3f}  action = {sample.action:+.3f}"
        self._title.set_text(numbers if title is None else title)
        return self.figure

    def record(self) -> None:
        """Do nothing: the picture stores nothing between frames."""

    @staticmethod
    def palette() -> Array:
        """Return the picture's colours for a GIF, (n, 3) from 0 to 1; n is at most 256."""
        scales = [(FIELD_COLOURS, 170), (SENSOR_COLOURS, 40), ("gray", 24)]
        colours = [mpl.colormaps[name](np.linspace(0.0, 1.0, count))[:, :3] for name, count in scales]
        # Anti-aliasing blends arrows and slots with black and white, so the palette contains these blends.
        blends = [
            np.linspace(end, mpl.colors.to_rgb(c), 6)[1:] for c in (BLOWING, SUCKING) for end in ((0, 0, 0), (1, 1, 1))
        ]
        return np.vstack([*colours, *blends])

    def pixels(self) -> npt.NDArray[np.uint8]:
        """Draw the present state as RGB pixels (height, width, 3)."""
        self.update()
        canvas: Any = self.figure.canvas
        canvas.draw()
        # The layout is kept, because computing it is slow, and because it must be the same in all frames.
        self.figure.set_layout_engine("none")
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def mean_figure(grid: Grid, body: BodyConfig, mean: Flow, duration: float) -> Figure:
    """Draw a mean flow (`wake.pictures.fields.mean_flow`) downstream of the body: u in colour, streamlines, the line
    u = 0, and the length of the recirculation bubble. The title states the mean's `duration` in t_c."""
    left, right, low, high = _NEAR_WAKE
    # Rounding makes the limits of the truck's view exactly 6.8 and 12.
    view = (round(body.length + left, 9), round(body.length + right, 9), low, high)
    figure, axes = _figure(10.0, 4.6, 110.0, view)
    image = draw_mean(axes, grid, body, mean, view, density=(2.0, 1.5))
    length = recirculation_length(grid, mean)
    if length > 0.0:
        axes.annotate(
            "", xy=(body.length, 0.0), xytext=(body.length + length, 0.0), zorder=6,
            arrowprops={"arrowstyle": "<->", "color": "white", "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
    axes.set_title(f"mean over {duration:.0f} $W/U_\\infty$:  bubble {length:.2f} W   (red: $u = 0$)")
    figure.colorbar(image, ax=axes, label=r"mean $u / U_\infty$", fraction=0.022, pad=0.012, extend="both")
    return figure


def draw_mean(
    axes: Axes, grid: Grid, body: BodyConfig, mean: Flow, view: View, *, density: tuple[float, float]
) -> AxesImage:
    """Draw the area `view` of a mean flow: u in colour, streamlines of the given density, the line u = 0, the body."""
    raster = Raster(grid.xc, grid.yc, view, 900)
    u, v = (raster(component) for component in velocity(mean))
    x, y = np.meshgrid(raster.x, raster.y)
    inside = (x > 0.0) & (x < body.length) & (np.abs(y) < HALF_WIDTH)
    u[inside] = v[inside] = np.nan
    image = axes.imshow(u, cmap="cividis", vmin=-0.25, vmax=1.25, extent=view, origin="lower", interpolation="bilinear")
    axes.streamplot(
        raster.x, raster.y, u, v, color=(1.0, 1.0, 1.0, 0.75), linewidth=0.7, arrowsize=0.7, density=density
    )
    axes.contour(raster.x, raster.y, u, levels=[0.0], colors="#ff4d4d", linewidths=1.4)
    _add_body(axes, body)
    return image


def check_suffix(path: Path) -> None:
    """Raise ConfigError if the path does not end in .png, .pdf or .svg, or is a folder."""
    if path.suffix.lower() not in PICTURES or path.is_dir():
        raise ConfigError(f"{path}: must be a file ending in {', '.join(PICTURES)}")


def save_figure(path: Path, figure: Figure) -> None:
    """Write the figure atomically, in the format of the suffix. Raises ConfigError for a wrong suffix or a folder."""
    check_suffix(path)
    with replacing(path) as temporary:
        figure.savefig(temporary, format=path.suffix[1:].lower())


def outline(body: BodyConfig) -> Array:
    """Return the n points of the body's outline, (n, 2)."""
    angle = np.linspace(np.pi, 0.5 * np.pi, 16)
    r = body.leading_edge_radius
    arc = np.column_stack([r + r * np.cos(angle), HALF_WIDTH - r + r * np.sin(angle)])
    upper = np.vstack([arc, [[body.length, HALF_WIDTH]]])
    return np.vstack([upper, upper[::-1] * (1.0, -1.0)])


def jet_arrow(share: float, side: int, base: float) -> Array:
    """Return the outline of the arrow at the upper (side 1) or lower (side -1) slot of a base at x = `base`, (7, 2).
    The arrow points away from the base for blowing (share > 0) and towards it for sucking, by |share|."""
    length, shaft, head = _FULL_JET * abs(share), JET_WIDTH, 2.4 * JET_WIDTH
    neck = max(length - 2.0 * head, 0.5 * length)
    x = np.array([0.0, neck, neck, length, neck, neck, 0.0])
    y = np.array([shaft, shaft, head, 0.0, -head, -shaft, -shaft])
    return np.column_stack([base + (x if share >= 0 else length - x), side * (HALF_WIDTH - 0.5 * JET_WIDTH) + y])


def _figure(width: float, height: float, dpi: float, view: View) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(xlim=view[:2], ylim=view[2:], aspect="equal", xlabel="x / W", ylabel="y / W")
    axes.xaxis.set_major_locator(MultipleLocator(2.0 if view[1] - view[0] > 10.0 else 0.5))
    return figure, axes


def _add_body(axes: Axes, body: BodyConfig) -> None:
    axes.add_patch(Polygon(outline(body), closed=True, facecolor="0.82", edgecolor="0.15", linewidth=0.8, zorder=3))
    for side in (1.0, -1.0):
        slot = side * np.array([HALF_WIDTH - JET_WIDTH, HALF_WIDTH])
        axes.plot([body.length, body.length], slot, color=BLOWING, linewidth=2.0, solid_capstyle="butt", zorder=4)


FASTEST: Final = 50
"""Largest number of frames per second. Many viewers play a GIF slowly if its frames are shorter than 20 ms."""
_GIF_TICK: Final = 10  # ms, because the format counts in hundredths of a second
_SUFFIXES: Final = (".gif", ".webp")
_WEBP: Final = {"quality": 80, "method": 4, "minimize_size": False, "kmax": 30}


class MovingPicture(Protocol):
    """A figure of fixed size, such as `WakePicture`, that shows the present state of a plant."""

    figure: Figure

    def record(self) -> None:
        """Record the present state; `animate` calls this after every control period from the first frame on."""

    def pixels(self) -> npt.NDArray[np.uint8]:
        """Draw the present state as RGB pixels (height, width, 3)."""

    def palette(self) -> Array:
        """Return the colours for a GIF, (n, 3) from 0 to 1; n is at most 256."""


def animate(
    path: Path,
    picture: MovingPicture,
    wake: TruckWake,
    actions: Array,
    *,
    skip: int = 0,
    every: int = 1,
    fps: int = 10,
    hold: float = 0.0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> int:
    """Run the plant from its present state to the end of the actions (n,), in U_inf W, and write the animation as .gif
    or .webp, completely or not at all. Return the number of frames. Raises ConfigError if the file type is not
    supported or the run has no frame; PlantError if an action exceeds the bound or the flow diverges.

    The first frame comes after `skip` control periods, and then one every `every` periods. A GIF rounds the time of a
    frame to 10 ms. The last frame is shown for `hold` more seconds. `progress` is called with (periods done, total).
    """
    check_target(path)
    if not 1 <= fps <= FASTEST:
        raise ConfigError(f"fps = {fps}: must be between 1 and {FASTEST}")
    if every < 1 or not 0 <= skip <= len(actions):
        raise ConfigError(f"every = {every} must be at least 1, skip = {skip} must be between 0 and {len(actions)}")
    is_gif, each = path.suffix.lower() == ".gif", round(1000 / fps)
    if is_gif:
        # All frames have one palette, so that colours neither flicker nor depend on the run.
        palette = Image.new("P", (1, 1))
        palette.putpalette(np.rint(255.0 * picture.palette()).astype(np.uint8).tobytes())
        each = _GIF_TICK * round(1000 / fps / _GIF_TICK)
    with replacing(path) as temporary:
        images = []
        for k in range(len(actions) + 1):
            if k >= skip:
                picture.record()
                if (k - skip) % every == 0:
                    image = Image.fromarray(picture.pixels())
                    images.append(image.quantize(palette=palette, dither=Image.Dither.NONE) if is_gif else image)
            if k < len(actions):
                wake.advance(float(actions[k]))
                progress(k + 1, len(actions))
        durations = [each] * (len(images) - 1) + [each + round(1e3 * hold)]
        settings: dict[str, Any] = {"format": "GIF"} if is_gif else {"format": "WEBP", **_WEBP}
        images[0].save(temporary, save_all=True, append_images=images[1:], duration=durations, loop=0, **settings)
    return len(images)


def check_target(path: Path) -> None:
    """Raise ConfigError if the path does not end in .gif or .webp, or is a folder."""
    if path.suffix.lower() not in _SUFFIXES or path.is_dir():
        raise ConfigError(f"{path}: must be a file ending in {' or '.join(_SUFFIXES)}")
