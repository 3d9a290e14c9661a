"""Pictures have the colours of their values. A film shows the beginning of control, and drag counted by the story."""

from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image
from PIL.GifImagePlugin import GifImageFile
from PIL.WebPImagePlugin import WebPImageFile

from contract import sensors
from contract.errors import ConfigError
from contract.geometry import LENGTH
from examples.film_of_a_run import CALM, Film, Story
from wake.pictures import drawing
from wake.truck.state import State, developed_state

pytestmark = pytest.mark.slow  # figures are drawn and written


def colour_at(picture: drawing.WakePicture, x: float, y: float) -> npt.NDArray[np.float64]:
    """The colour (3,) in [0, 1] drawn at a place in W."""
    pixels = picture.pixels()
    column, row = picture.figure.axes[0].transData.transform((x, y))
    return pixels[pixels.shape[0] - 1 - int(row), int(column)] / 255.0


def count(pixels: npt.NDArray[np.uint8], colour: str) -> int:
    wanted = 255.0 * np.array(mpl.colors.to_rgb(colour))
    return int((np.abs(pixels - wanted) < 3.0).all(axis=2).sum())


def test_fields_and_sensors_have_the_colours_of_their_values(wake, monkeypatch):
    grid = wake.grid
    wake.flow.faces_u[:], wake.flow.faces_v[:] = -grid.yc, grid.xc[:, None]
    # Vorticity 2 on a scale of +-4, turning to the left; one step of an 8-bit colour map.
    drawn = colour_at(drawing.WakePicture(wake), 13.0, 1.5)
    assert drawn == pytest.approx(mpl.colormaps[drawing.FIELD_COLOURS](0.75)[:3], abs=0.02)
    wake.flow.flat[:] = 0.0
    wake.flow.p[:] = -0.2
    picture = drawing.WakePicture(wake, "vorticity", ("upper_10", "base_4"))
    drawn = colour_at(drawing.WakePicture(wake, "pressure"), 13.0, 1.5)
    assert drawn == pytest.approx(mpl.colormaps[drawing.FIELD_COLOURS](0.3)[:3], abs=0.02)
    share = (-0.4 - drawing.SENSOR_RANGE[0]) / (drawing.SENSOR_RANGE[1] - drawing.SENSOR_RANGE[0])
    for x, y in sensors.TRUCK.positions[sensors.TRUCK.indices(("upper_10", "base_4"))]:
        assert colour_at(picture, x, y) == pytest.approx(mpl.colormaps[drawing.SENSOR_COLOURS](share)[:3], abs=0.02)
    monkeypatch.setattr(wake, "pressure", lambda: None)
    with pytest.raises(ConfigError, match="only with stillwake's solver"):
        drawing.WakePicture(wake, "pressure")


def test_blowing_and_sucking_differ_and_grow_with_the_action(wake):
    state = wake.state()
    # The picture of a wake this long resolves an arrow only at some width.
    picture = drawing.WakePicture(wake, width=2200)
    picture.pixels()
    # Behind the base and clear of the slots' own marks.
    column, row = picture.figure.axes[0].transData.transform((LENGTH + 0.15, 0.0))
    found = []
    for action in (0.0, 0.03, 0.075, -0.075):
        wake.reset(State(flat=state.flat, substep=0, action=action))
        behind = picture.pixels()[:, int(column) : int(column) + 60]
        halves = behind[: len(behind) - int(row)], behind[len(behind) - int(row) :]
        found += [[count(half, colour) for half in halves] for colour in (drawing.BLOWING, drawing.SUCKING)]
    drawn = np.array(found).reshape(4, 2, 2)  # action, colour, half
    assert (drawn > 0).tolist() == [
        [[False, False]] * 2, *[[[True, False], [False, True]]] * 2, [[False, True], [True, False]]
    ]  # fmt: skip
    assert (drawn[2] >= drawn[1]).all() and drawn[2].sum() > drawn[1].sum()


def test_figures_are_written_in_the_format_they_are_named_after(wake, tmp_path):
    wake.flow.faces_u[:] = wake.grid.xf[:, None] - LENGTH - 1.25
    figure = drawing.mean_figure(wake.grid, wake.body, wake.flow, 10.0)
    assert "bubble 1.25 W" in figure.axes[0].get_title()
    for name, head in (("a.png", b"\x89PNG"), ("a.PDF", b"%PDF"), ("a.svg", b"<?xml")):
        drawing.save_figure(tmp_path / name, figure)
        assert (tmp_path / name).read_bytes().startswith(head)
    assert Image.open(tmp_path / "a.png").size == (1100, 506)
    with pytest.raises(ConfigError, match=r"a\.bmp: must be a file ending in \.png, \.pdf, \.svg"):
        drawing.save_figure(tmp_path / "a.bmp", figure)


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
    picture = drawing.WakePicture(wake, width=500)
    for name, kind, options, durations in (
        ("b.gif", GifImageFile, {"fps": 30, "skip": 1, "every": 2}, [30] * 2),
        ("a.webp", WebPImageFile, {"fps": 20, "hold": 1.5}, [50, 50, 50, 1550]),
    ):
        wake.reset(developed_state())
        calls: list[tuple[int, int]] = []
        settings: dict[str, Any] = {**options, "progress": lambda *done, to=calls: to.append(done)}
        made = drawing.animate(tmp_path / name, picture, wake, np.array([0.01, 0.03, 0.07]), **settings)
        found, last = frames_of(tmp_path / name, kind)
        assert (made, found) == (len(durations), durations), name
        assert calls == [(1, 3), (2, 3), (3, 3)]
        assert wake.sample().action == 0.07
        # 256 colours stand for all of the picture's.
        assert np.abs(last - picture.pixels()).mean() < 3.0, name
    with pytest.raises(ConfigError, match=r"a\.avi: must be a file ending in \.gif or \.webp"):
        drawing.animate(tmp_path / "a.avi", picture, wake, np.zeros(3))
    with pytest.raises(ConfigError, match="fps = 0: must be between 1 and 50"):
        drawing.animate(tmp_path / "a.gif", picture, wake, np.zeros(3), fps=0)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["a.webp", "b.gif"]


def test_a_film_shows_when_control_begins_and_the_drag_of_a_cycle_under_it(wake, monkeypatch):
    sample = wake.sample()
    film = Film(wake, Story(begin=0.0, end=20.0, control=10.0, drag_before=1.0), ("base_0",), 960)
    assert "1 wall-pressure sensor" in [text.get_text() for text in film.figure.axes[0].texts]
    shown, lit = [], []
    for t in np.arange(0.0, 18.01, 0.5):
        # Without control 1.3, which must not count; then 0.9 for 5 t_c, and 0.7.
        said = replace(sample, t=float(t), Cd=1.3 if t < 10.0 else 0.9 if t <= 15.0 else 0.7)
        monkeypatch.setattr(wake, "sample", lambda said=said: said)
        film.record()
        film.update()
        shown.append(film.figure.texts[0].get_text())
        if t in (9.5, 10.0, 14.0):
            # The left edge, halfway down the flow: next to the truck's flank.
            lit.append(count(film.pixels()[40:100, :4], CALM))
    assert set(shown[:30]) == {""}
    # At 15 a cycle lies behind: -10 %. At 18 the last 5 t_c hold 4 of 0.9 and 6 of 0.7.
    assert (shown[30], shown[36]) == ("\N{MINUS SIGN}10 %", "\N{MINUS SIGN}22 %")
    assert lit[0] == lit[2] == 0 < lit[1]
