import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from PIL import Image
from PIL.GifImagePlugin import GifImageFile
from PIL.WebPImagePlugin import WebPImageFile

from contract.errors import ConfigError, PlantError
from wake.pictures.animation import animate
from wake.pictures.drawing import WakePicture

pytestmark = pytest.mark.slow  # frames are drawn


@pytest.fixture
def picture(wake) -> WakePicture:
    return WakePicture(wake, width=500)


@pytest.mark.parametrize(
    # 3 steps have 4 instants; a frame lasts whole hundredths of a second, so 30 in a second become 33.
    ("skip", "every", "fps", "frames", "duration"),
    [(0, 1, 10, 4, 100), (1, 2, 30, 2, 30)],
)
def test_a_gif_has_its_frames_and_their_time(wake, picture, tmp_path, skip, every, fps, frames, duration):
    path, calls = tmp_path / "a.gif", []
    actions = np.array([0.01, 0.03, 0.07])
    made = animate(
        path, picture, wake, actions, skip=skip, every=every, fps=fps, progress=lambda *done: calls.append(done)
    )
    with Image.open(path) as gif:
        assert isinstance(gif, GifImageFile)
        assert (made, gif.n_frames, gif.info["loop"]) == (frames, frames, 0)
        durations = []
        for k in range(gif.n_frames):
            gif.seek(k)
            durations.append(gif.info["duration"])
        last = np.asarray(gif.convert("RGB"), dtype=float)
    assert durations == [duration] * frames
    assert calls == [(1, 3), (2, 3), (3, 3)]
    assert wake.sample().action == 0.07
    # 256 colours stand for all of the picture's.
    assert np.abs(last - picture.pixels()).mean() < 3.0
    assert list(tmp_path.iterdir()) == [path]


def test_a_webp_has_its_frames_and_holds_the_last(wake, picture, tmp_path):
    path = tmp_path / "a.webp"
    assert animate(path, picture, wake, np.array([0.0, 0.03]), fps=20, hold=1.5) == 3
    with Image.open(path) as webp:
        assert isinstance(webp, WebPImageFile)
        durations = []
        for k in range(webp.n_frames):
            webp.seek(k)
            webp.load()
            durations.append(webp.info["duration"])
        last = np.asarray(webp.convert("RGB"), dtype=float)
    assert durations == [50, 50, 1550]
    assert np.abs(last - picture.pixels()).mean() < 3.0


def test_a_run_that_fails_leaves_nothing(wake, picture, tmp_path):
    with pytest.raises(PlantError, match=r"action 0\.2"):
        animate(tmp_path / "a.gif", picture, wake, np.array([0.0, 0.2]))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("a.avi", {}, r"a\.avi: must be a file ending in \.gif, \.webp or \.mp4"),
        ("a.mp4", {}, "needs ffmpeg, which is not installed"),
        ("a.gif", {"fps": 0}, "fps = 0: must be between 1 and 50"),
        ("a.gif", {"every": 0}, "every = 0"),
        ("a.gif", {"skip": 4}, "skip = 4"),
    ],
)
def test_what_cannot_be_made_is_refused_before_the_run(wake, picture, tmp_path, name, settings, message):
    with mpl.rc_context({"animation.ffmpeg_path": "no-such-program"}), pytest.raises(ConfigError, match=message):
        animate(tmp_path / name, picture, wake, np.zeros(3), **settings)
    assert wake.t == 0.0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="ffmpeg is not installed")
def test_an_mp4_where_ffmpeg_is_installed(wake, picture, tmp_path):
    assert animate(tmp_path / "a.mp4", picture, wake, np.zeros(2)) == 3
    assert (tmp_path / "a.mp4").read_bytes()[4:8] == b"ftyp"
