from typing import Any

import numpy as np
import pytest
from PIL import Image
from PIL.GifImagePlugin import GifImageFile
from PIL.WebPImagePlugin import WebPImageFile

from contract.errors import ConfigError
from wake.pictures.drawing import WakePicture, animate
from wake.truck.state import developed_state

pytestmark = pytest.mark.slow  # frames are drawn


def frames_of(path, kind):
    """Duration of every frame in ms, and the last one's pixels."""
    with Image.open(path) as picture:
        assert isinstance(picture, kind)
        durations = []
        for k in range(picture.n_frames):
            picture.seek(k)
            picture.load()
            durations.append(picture.info["duration"])
        return durations, np.asarray(picture.convert("RGB"), dtype=float)


def test_pictures_that_move_have_their_frames_and_their_time(wake, tmp_path):
    """3 steps have 4 instants; a GIF's frame lasts whole hundredths of a second, so 30 in a second become 33."""
    picture = WakePicture(wake, width=500)
    for name, kind, options, durations in (
        ("b.gif", GifImageFile, {"fps": 30, "skip": 1, "every": 2}, [30] * 2),
        ("a.webp", WebPImageFile, {"fps": 20, "hold": 1.5}, [50, 50, 50, 1550]),
    ):
        wake.reset(developed_state())
        calls: list[tuple[int, int]] = []
        settings: dict[str, Any] = {**options, "progress": lambda *done, to=calls: to.append(done)}
        made = animate(tmp_path / name, picture, wake, np.array([0.01, 0.03, 0.07]), **settings)
        found, last = frames_of(tmp_path / name, kind)
        assert (made, found) == (len(durations), durations), name
        assert calls == [(1, 3), (2, 3), (3, 3)]
        assert wake.sample().action == 0.07
        # 256 colours stand for all of the picture's.
        assert np.abs(last - picture.pixels()).mean() < 3.0, name
    with pytest.raises(ConfigError, match=r"a\.avi: must be a file ending in \.gif or \.webp"):
        animate(tmp_path / "a.avi", picture, wake, np.zeros(3))
    with pytest.raises(ConfigError, match="fps = 0: must be between 1 and 50"):
        animate(tmp_path / "a.gif", picture, wake, np.zeros(3), fps=0)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["a.webp", "b.gif"]
