"""The animation of a run of the wake, as a GIF or WebP file by Pillow."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from PIL import Image

from contract.arrays import Array
from contract.atomic import replacing
from contract.errors import ConfigError
from wake.truck.truck_wake import TruckWake

Pixels = npt.NDArray[np.uint8]
_Progress = Callable[[int, int], None]

FASTEST: Final = 50
"""Largest number of frames per second. Many viewers play a GIF slowly if its frames are shorter than 20 ms."""
_GIF_TICK: Final = 10  # ms, because the format counts in hundredths of a second
_SUFFIXES: Final = (".gif", ".webp")
_WEBP: Final = {"quality": 80, "method": 4, "minimize_size": False, "kmax": 30}


class MovingPicture(Protocol):
    """A figure of fixed size, such as `WakePicture`, that shows the present state of a plant."""

    figure: Figure

    def record(self) -> None:
        """Record the plant's present state; called after every control period from the first frame on."""

    def pixels(self) -> Pixels:
        """Draw the present state as RGB pixels (height, width, 3)."""

    def palette(self) -> Array:
        """Return the n <= 256 colours for a GIF, (n, 3), from 0 to 1."""


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
    progress: _Progress = lambda done, total: None,
) -> int:
    """Run the plant from its present state to the end of the actions, and write the animation, completely or not at
    all. Return the number of frames. Raises ConfigError for another file type, or a run without frames; PlantError for
    an action beyond the bound, or if the flow diverges.

    Args:
        path: file to write; its name ends in .gif or .webp.
        picture: draws the plant `wake`.
        actions: commands for n control periods, (n,), in U_inf W.
        skip: number of control periods before the first frame.
        every: number of control periods between frames.
        fps: number of frames per second; a GIF rounds the time of a frame to 10 ms.
        hold: additional time in s for which the last frame is shown.
        progress: called with (control periods done, total).
    """
    check_target(path)
    if not 1 <= fps <= FASTEST:
        raise ConfigError(f"fps = {fps}: must be between 1 and {FASTEST}")
    if every < 1 or not 0 <= skip <= len(actions):
        raise ConfigError(f"every = {every}, skip = {skip}: must be at least 1, and between 0 and {len(actions)} steps")
    frames = _frames(picture, wake, actions, skip, every, progress)
    is_gif, each = path.suffix.lower() == ".gif", round(1000 / fps)
    if is_gif:
        # All frames have one palette, so that colours neither flicker nor depend on the run.
        palette = Image.new("P", (1, 1))
        palette.putpalette(np.rint(255.0 * picture.palette()).astype(np.uint8).tobytes())
        each = _GIF_TICK * round(1000 / fps / _GIF_TICK)
    with replacing(path) as temporary:
        images = []
        for frame in frames:
            image = Image.fromarray(frame)
            images.append(image.quantize(palette=palette, dither=Image.Dither.NONE) if is_gif else image)
        durations = [each] * (len(images) - 1) + [each + round(1e3 * hold)]
        settings: dict[str, Any] = {"format": "GIF"} if is_gif else {"format": "WEBP", **_WEBP}
        images[0].save(temporary, save_all=True, append_images=images[1:], duration=durations, loop=0, **settings)
    return len(images)


def check_target(path: Path) -> None:
    """Raise ConfigError if the path does not end in .gif or .webp, or is a folder."""
    if path.suffix.lower() not in _SUFFIXES or path.is_dir():
        raise ConfigError(f"{path}: must be a file ending in {' or '.join(_SUFFIXES)}")


def _frames(
    picture: MovingPicture, wake: TruckWake, actions: Array, skip: int, every: int, progress: _Progress
) -> Iterator[Pixels]:
    for k in range(len(actions) + 1):
        if k >= skip:
            picture.record()
            if (k - skip) % every == 0:
                yield picture.pixels()
        if k < len(actions):
            wake.advance(float(actions[k]))
            progress(k + 1, len(actions))
