"""Pictures of the flow."""

from typing import Final, Protocol

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from contract import sensors
from contract.config import FlowConfig
from contract.geometry import HALF_WIDTH, LEADING_EDGE_RADIUS, LENGTH
from wake.grid import Grid
from wake.truck_wake import Sample

Array = npt.NDArray[np.float64]


class Pictured(Protocol):
    """What a picture needs of a plant."""

    @property
    def grid(self) -> Grid: ...
    @property
    def config(self) -> FlowConfig: ...
    @property
    def t(self) -> float:
        """Time in t_c."""

    def sample(self) -> Sample:
        """Measure now."""

    def vorticity(self) -> Array:
        """In the grid's inner corners, (nx - 1, ny - 1); units U_inf / W."""


VIEW: Final = (-1.5, 20.0, -3.0, 3.0)
"""Shown part of the domain: x and y limits in W."""

_LEVEL: Final = 4.0  # vorticity at the ends of the colour scale, U_inf / W


def vorticity_figure(wake: Pictured, highlight: tuple[str, ...] = (), title: str = "") -> Figure:
    """Vorticity around the truck, the jets as arrows, sensors as dots, the highlighted ones larger."""
    figure = Figure(figsize=(10.0, 3.1), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    mesh = axes.pcolormesh(
        wake.grid.xf[1:-1], wake.grid.yf[1:-1], wake.vorticity().T, cmap="RdBu_r", vmin=-_LEVEL, vmax=_LEVEL,
        shading="gouraud", rasterized=True,
    )  # fmt: skip
    axes.add_patch(Polygon(outline(), closed=True, facecolor="0.85", edgecolor="0.2", linewidth=0.8, zorder=3))
    places = sensors.positions()
    axes.plot(places[:, 0], places[:, 1], ".", color="0.45", markersize=1.5, zorder=4)
    if highlight:
        chosen = places[sensors.indices(highlight)]
        axes.plot(chosen[:, 0], chosen[:, 1], "o", color="tab:green", markersize=5, zorder=5)
    action = wake.sample().action / wake.config.action_limit
    if abs(action) > 1e-3:
        for side in (1.0, -1.0):
            axes.annotate(
                "", xy=(LENGTH + 0.9 * action * side, side * 0.475), xytext=(LENGTH, side * 0.475),
                arrowprops={"arrowstyle": "->", "color": "tab:orange", "linewidth": 1.8}, zorder=6,
            )  # fmt: skip
    axes.set(xlim=VIEW[:2], ylim=VIEW[2:], aspect="equal", xlabel="x / W", ylabel="y / W", title=title)
    figure.colorbar(mesh, ax=axes, label=r"$\omega_z W / U_\infty$", fraction=0.02, pad=0.01)
    return figure


def vorticity_image(wake: Pictured) -> npt.NDArray[np.uint8]:
    """The same as pixels, (height, width, 3)."""
    with mpl.rc_context({"font.size": 9}):
        canvas = FigureCanvasAgg(vorticity_figure(wake, title=f"t = {wake.t:.1f} $t_c$"))
        canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]


def outline() -> Array:
    """Points of the truck's outline, (n, 2)."""
    angle = np.linspace(np.pi, 0.5 * np.pi, 16)
    r = LEADING_EDGE_RADIUS
    arc = np.column_stack([r + r * np.cos(angle), HALF_WIDTH - r + r * np.sin(angle)])
    upper = np.vstack([arc, [[LENGTH, HALF_WIDTH]]])
    return np.vstack([upper, upper[::-1] * (1.0, -1.0)])
