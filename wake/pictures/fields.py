"""The fields of a flow for pictures: values in the cell centres, averages over time, and an interpolation to pixels.

The live page, the run folder and the report use a picture whose pixels are small integers, the levels. Levels take
little space, and the page that shows the picture chooses a colour for each level.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from contract.arrays import Array
from contract.errors import PlantError
from contract.geometry import HALF_WIDTH
from wake.plant.protocol import LivePlant
from wake.solver.grid import Flow
from wake.truck.truck_wake import TruckWake

View = tuple[float, float, float, float]
"""The visible part of the domain: x and y limits in W."""


def velocity(flow: Flow) -> tuple[Array, Array]:
    """Return u and v in the cell centres, (nx, ny) each, in U_inf."""
    u, v = flow.faces_u, flow.faces_v
    return 0.5 * (u[1:] + u[:-1]), 0.5 * (v[:, 1:] + v[:, :-1])


def mean_flow(
    wake: TruckWake, actions: Array, skip: int = 0, progress: Callable[[int, int], None] = lambda done, total: None
) -> Flow:
    """Run the plant from its present state with the actions, one per control period. Return the mean of the flows at
    the ends of all control periods except the first `skip` periods. Wall pressures and wall forces are linear functions
    of a flow's buffer, so the mean flow gives their means. Raises PlantError if no period remains."""
    if len(actions) <= skip:
        raise PlantError("the mean flow needs at least one control period after the skipped periods")
    mean = Flow.zeros(wake.grid.shape)
    for k, action in enumerate(actions):
        wake.advance(float(action))
        if k >= skip:
            mean.flat[:] += wake.flow.flat
        progress(k + 1, len(actions))
    mean.flat[:] /= len(actions) - skip
    return mean


class Raster:
    """A linear interpolation from the nodes of a tensor grid to square pixels, `width` of them across `view`. Outside
    the outermost nodes the field is constant. The pixels' centres are x (width,) and y (height,), in increasing order.
    """

    def __init__(self, nodes_x: Array, nodes_y: Array, view: View, width: int) -> None:
        size = (view[1] - view[0]) / width
        self.x = np.asarray(view[0] + size * (np.arange(width) + 0.5), dtype=np.float64)
        self.y = np.asarray(view[2] + size * (np.arange(round((view[3] - view[2]) / size)) + 0.5), dtype=np.float64)
        self._across, self._up = _weights(nodes_x, self.x), _weights(nodes_y, self.y)

    def __call__(self, field: Array) -> Array:
        """Interpolate a field (len(nodes_x), len(nodes_y)) to pixels (height, width). Row 0 is at the bottom."""
        return np.asarray(self._up @ (self._across @ field).T)


def _weights(nodes: Array, at: Array) -> csr_array:
    at = np.clip(at, nodes[0], nodes[-1])
    right = np.clip(np.searchsorted(nodes, at), 1, len(nodes) - 1)
    share = (at - nodes[right - 1]) / (nodes[right] - nodes[right - 1])
    rows = np.arange(len(at))
    places = (np.concatenate([rows, rows]), np.concatenate([right - 1, right]))
    return csr_array((np.concatenate([1.0 - share, share]), places), shape=(len(at), len(nodes)))


Levels = npt.NDArray[np.int8]
"""A picture in levels, (height, width), with the first row at the top."""
FIELD_LEVEL: Final = 5.0
"""|vorticity| at the ends of the colour scale, in U_inf / W."""
TOP: Final = 127
"""The level of the vorticity `FIELD_LEVEL`, and the largest level."""


def field_levels(vorticity: Array) -> Levels:
    """Return the levels of the vorticity w: `sign(w) * sqrt(|w| / FIELD_LEVEL) * TOP`, clipped. The root makes weak,
    distant vortices visible. Row 0 of w, (height, width), is at the bottom; row 0 of the levels is at the top."""
    # Memory access takes most of the time, so computing in place and in float32 is three times as fast.
    squares = np.asarray(vorticity[::-1], dtype=np.float32) * np.float32(TOP**2 / FIELD_LEVEL)
    np.clip(squares, -float(TOP**2), float(TOP**2), out=squares)
    levels = np.abs(squares)
    np.sqrt(levels, out=levels)
    np.copysign(levels, squares, out=levels)
    return np.asarray(np.rint(levels, out=levels), dtype=np.int8)


_WIDTH: Final = 480
"""Width of the picture in pixels."""
_BEFORE_BASE: Final = 3.0
_BEHIND_BASE: Final = 9.0
_HALF_HEIGHT: Final = 2.25
"""Half the height of the picture in W; the picture has 40 pixels per W and is 180 pixels high."""


class LevelPicture:
    """A picture of a plant's present vorticity. The level is 0 inside the body. `size` is (width, height) in pixels."""

    def __init__(self, wake: LivePlant) -> None:
        self._wake = wake
        left, right = (round(wake.body.length + each, 9) for each in (-_BEFORE_BASE, _BEHIND_BASE))
        self.view: View = (left, right, -_HALF_HEIGHT, _HALF_HEIGHT)
        self._raster = Raster(wake.grid.xf[1:-1], wake.grid.yf[1:-1], self.view, _WIDTH)
        x, y = self._raster.x, self._raster.y
        self._flow = ((x[None, :] < 0.0) | (x[None, :] > wake.body.length)) | (np.abs(y[:, None]) > HALF_WIDTH)
        self.size = (_WIDTH, len(y))

    def levels(self) -> Levels:
        """Return the levels of the present state, (height, width)."""
        return field_levels(self._raster(np.asarray(self._wake.vorticity())) * self._flow)
