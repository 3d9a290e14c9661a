"""The picture of a wake in levels, for the live page, the run folder and the report. Levels are small integers. They
take little space, and the page that shows them chooses the colours."""

from typing import Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.geometry import HALF_WIDTH
from wake.pictures.fields import Raster, View
from wake.plant.protocol import Drawable

Levels = npt.NDArray[np.int8]
"""A picture in levels, (height, width), with the first row at the top."""

FIELD_LEVEL: Final = 5.0
"""|vorticity| at the ends of the colour scale, in U_inf / W."""
TOP: Final = 127
"""The level that stands for the vorticity `FIELD_LEVEL`."""


def field_levels(vorticity: Array) -> Levels:
    """Return the levels of the vorticity w: sign(w) (|w| / FIELD_LEVEL)^(1/2) TOP, clipped. The root makes weak
    vortices far downstream visible. Row 0 of w, (height, width), is at the bottom; row 0 of the levels is at the
    top."""
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
    """A picture of a plant's present vorticity; its level is 0 inside the body. `view` are the x and y limits in W,
    `size` is (width, height) in pixels."""

    def __init__(self, wake: Drawable) -> None:
        self._wake = wake
        left, right = (round(wake.body.length + each, 9) for each in (-_BEFORE_BASE, _BEHIND_BASE))
        self.view: View = (left, right, -_HALF_HEIGHT, _HALF_HEIGHT)
        self._raster = Raster.of(wake.grid.xf[1:-1], wake.grid.yf[1:-1], self.view, _WIDTH)
        x, y = self._raster.x, self._raster.y
        self._flow = ((x[None, :] < 0.0) | (x[None, :] > wake.body.length)) | (np.abs(y[:, None]) > HALF_WIDTH)
        self.size = (_WIDTH, len(y))

    def levels(self) -> Levels:
        """Return the levels of the present state, (height, width)."""
        return field_levels(self._raster(np.asarray(self._wake.vorticity())) * self._flow)
