"""A run of the wake as a moving picture: GIF through Pillow, MP4 where ffmpeg is installed."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.animation import FFMpegWriter
from PIL import Image

from contract.arrays import Array
from contract.atomic import replacing
from contract.errors import ConfigError
from wake.pictures.drawing import BLOWING, FIELD_COLOURS, SENSOR_COLOURS, SUCKING, WakePicture
from wake.truck.truck_wake import TruckWake

Pixels = npt.NDArray[np.uint8]
Progress = Callable[[int, int], None]

FASTEST: Final = 50
"""Frames per second: many viewers play a GIF with frames shorter than 20 ms slowly."""
_GIF_TICK: Final = 10  # ms; the format counts in hundredths of a second


def animate(
    path: Path,
    picture: WakePicture,
    wake: TruckWake,
    actions: Array,
    *,
    skip: int = 0,
    every: int = 1,
    fps: int = 10,
    progress: Progress = lambda done, total: None,
) -> int:
    """Run the plant from its present state and write what it shows, whole or not at all.

    Args:
        path: ends in .gif or .mp4.
        picture: of the same plant.
        wake: the plant, moved to the end of the run.
        actions: commanded in turn, one a control period, (n,); U_inf W.
        skip: control periods that pass before the first frame.
        every: control periods between frames.
        fps: frames per second; a GIF rounds the time of a frame to 10 ms.
        progress: called with (control periods done, in all).

    Returns:
        The number of frames.

    Raises:
        ConfigError: for another file type, ffmpeg missing, or a run without frames.
        PlantError: for an action beyond the bound, or if the flow diverges.
    """
    check_target(path)
    if not 1 <= fps <= FASTEST:
        raise ConfigError(f"fps = {fps}: must be between 1 and {FASTEST}")
    if every < 1 or not 0 <= skip <= len(actions):
        raise ConfigError(f"every = {every}, skip = {skip}: must be at least 1, and between 0 and {len(actions)} steps")
    frames = _frames(picture, wake, actions, skip, every, progress)
    with replacing(path) as temporary:
        if path.suffix.lower() == ".gif":
            return _write_gif(temporary, frames, fps)
        return _write_mp4(temporary, picture, frames, fps)


def check_target(path: Path) -> None:
    """Raises ConfigError if a moving picture of that name cannot be made."""
    suffix = path.suffix.lower()
    if suffix not in (".gif", ".mp4") or path.is_dir():
        raise ConfigError(f"{path}: must be a file ending in .gif or .mp4")
    if suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise ConfigError(f"{path}: needs ffmpeg, which is not installed; a name ending in .gif needs nothing")


def _frames(
    picture: WakePicture, wake: TruckWake, actions: Array, skip: int, every: int, progress: Progress
) -> Iterator[Pixels]:
    for k in range(len(actions) + 1):
        if k >= skip and (k - skip) % every == 0:
            yield picture.pixels()
        if k < len(actions):
            wake.advance(float(actions[k]))
            progress(k + 1, len(actions))


def _write_gif(path: Path, frames: Iterator[Pixels], fps: int) -> int:
    palette = _palette()
    images = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    duration = _GIF_TICK * round(1000 / fps / _GIF_TICK)
    images[0].save(path, format="GIF", save_all=True, append_images=images[1:], duration=duration, loop=0)
    return len(images)


def _palette() -> Image.Image:
    """One for all frames, so that colours neither flicker nor depend on the run: the pictures' own colours."""
    scales = [(FIELD_COLOURS, 170), (SENSOR_COLOURS, 40), ("gray", 24)]
    colours = [mpl.colormaps[name](np.linspace(0.0, 1.0, count))[:, :3] for name, count in scales]
    # Edges of the arrows and the slots blend into black and white.
    blends = [
        np.linspace(end, mpl.colors.to_rgb(c), 6)[1:] for c in (BLOWING, SUCKING) for end in ((0, 0, 0), (1, 1, 1))
    ]
    table = np.vstack([*colours, *blends])
    image = Image.new("P", (1, 1))
    image.putpalette(np.rint(255.0 * table).astype(np.uint8).tobytes())
    return image


def _write_mp4(path: Path, picture: WakePicture, frames: Iterator[Pixels], fps: int) -> int:
    # The container is named, because the temporary file's suffix is another; players want even sizes in 4:2:0.
    options = ["-f", "mp4", "-pix_fmt", "yuv420p", "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2"]
    writer: Any = FFMpegWriter(fps=fps, extra_args=options)
    count = 0
    with writer.saving(picture.figure, str(path), picture.figure.dpi):
        for _ in frames:
            writer.grab_frame()
            count += 1
    return count
