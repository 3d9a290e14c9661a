import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from contract import sensors
from contract.errors import ConfigError
from contract.geometry import LENGTH
from wake.pictures.drawing import (
    BLOWING,
    FIELD_COLOURS,
    SENSOR_COLOURS,
    SENSOR_RANGE,
    SUCKING,
    WakePicture,
    mean_figure,
    save_figure,
    vorticity_figure,
)
from wake.truck.state import State

pytestmark = pytest.mark.slow  # figures are drawn and written

Pixels = npt.NDArray[np.uint8]


def colour_at(picture: WakePicture, pixels: Pixels, x: float, y: float) -> npt.NDArray[np.float64]:
    """The colour (3,) in [0, 1] drawn at a place in W."""
    column, row = picture.figure.axes[0].transData.transform((x, y))
    return pixels[pixels.shape[0] - 1 - int(row), int(column)] / 255.0


def count(pixels: Pixels, colour: str) -> int:
    wanted = 255.0 * np.array(mpl.colors.to_rgb(colour))
    return int((np.abs(pixels - wanted) < 3.0).all(axis=2).sum())


def halves(picture: WakePicture, pixels: Pixels) -> tuple[Pixels, Pixels]:
    """Above and below the axis of symmetry, behind the base and clear of the slots' own marks."""
    column, row = picture.figure.axes[0].transData.transform((LENGTH + 0.15, 0.0))
    behind = pixels[:, int(column) : int(column) + 60]
    return behind[: pixels.shape[0] - int(row)], behind[pixels.shape[0] - int(row) :]


def test_vorticity_is_red_where_it_turns_to_the_left(wake):
    grid = wake.grid
    for sign in (1.0, -1.0):
        wake.flow.faces_u[:] = -sign * grid.yc
        wake.flow.faces_v[:] = sign * grid.xc[:, None]
        picture = WakePicture(wake)
        drawn = colour_at(picture, picture.pixels(), 13.0, 1.5)
        # Vorticity +-2 on a scale of +-4; one step of an 8-bit colour map.
        expected = mpl.colormaps[FIELD_COLOURS](0.5 + 0.25 * sign)[:3]
        assert drawn == pytest.approx(expected, abs=0.02)


def test_sensors_take_the_colour_of_their_pressure_and_the_truck_is_filled(wake):
    wake.flow.flat[:] = 0.0
    wake.flow.p[:] = -0.2
    names = ("upper_10", "lower_20", "base_4")
    picture = WakePicture(wake, "vorticity", names)
    pixels = picture.pixels()
    share = (-0.4 - SENSOR_RANGE[0]) / (SENSOR_RANGE[1] - SENSOR_RANGE[0])
    for x, y in sensors.positions()[sensors.TRUCK.indices(names)]:
        drawn = colour_at(picture, pixels, x, y)
        assert drawn == pytest.approx(mpl.colormaps[SENSOR_COLOURS](share)[:3], abs=0.02)
    assert colour_at(picture, pixels, 0.5 * LENGTH, 0.0) == pytest.approx((0.82, 0.82, 0.82), abs=0.01)


def test_pressure_is_drawn_on_a_scale_about_zero_where_the_plant_has_it(wake, monkeypatch):
    wake.flow.flat[:] = 0.0
    wake.flow.p[:] = 0.25
    picture = WakePicture(wake, "pressure")
    expected = mpl.colormaps[FIELD_COLOURS](0.75)[:3]
    assert colour_at(picture, picture.pixels(), 13.0, 1.5) == pytest.approx(expected, abs=0.02)
    monkeypatch.setattr(wake, "pressure", lambda: None)
    with pytest.raises(ConfigError, match="own solver only"):
        WakePicture(wake, "pressure")
    assert WakePicture(wake, "vorticity").pixels().shape == (341, 1100, 3)


def test_blowing_and_sucking_differ_and_grow_with_the_action(wake):
    state = wake.state()
    # The picture of a wake this long resolves an arrow only at some width.
    picture = WakePicture(wake, width=2200)
    orange, purple = [], []
    for action in (0.0, 0.03, 0.075, -0.075):
        wake.reset(State(flat=state.flat, substep=0, action=action))
        above, below = halves(picture, picture.pixels())
        orange.append((count(above, BLOWING), count(below, BLOWING)))
        purple.append((count(above, SUCKING), count(below, SUCKING)))
    assert orange[0] == purple[0] == (0, 0)
    assert 0 < orange[1][0] < orange[2][0] and orange[1][1] == orange[2][1] == 0
    assert 0 < purple[1][1] < purple[2][1] and purple[1][0] == purple[2][0] == 0
    assert orange[3][0] == purple[3][1] == 0 and min(orange[3][1], purple[3][0]) > 0


def test_figures_are_written_in_the_format_they_are_named_after(wake, tmp_path):
    figure = vorticity_figure(wake, ("base_0",), title="one")
    for name, head in (("a.png", b"\x89PNG"), ("a.PDF", b"%PDF"), ("a.svg", b"<?xml")):
        save_figure(tmp_path / name, figure)
        assert (tmp_path / name).read_bytes().startswith(head)
    with pytest.raises(ConfigError, match=r"a\.bmp: must be a file ending in \.png, \.pdf, \.svg"):
        save_figure(tmp_path / "a.bmp", figure)
    assert not (tmp_path / "a.bmp").exists()
    # A mean is drawn with the numbers of its flow.
    wake.flow.faces_u[:] = wake.grid.xf[:, None] - LENGTH - 1.25
    figure = mean_figure(wake.grid, wake.body, wake.flow, 10.0)
    assert "bubble 1.25 W" in figure.axes[0].get_title()
    save_figure(tmp_path / "a.png", figure)
    assert Image.open(tmp_path / "a.png").size == (1100, 506)
