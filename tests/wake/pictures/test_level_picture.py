"""The wake in levels: of known vorticities, the right way up, and nothing inside the body."""

import numpy as np
import pytest

from wake.pictures.level_picture import LevelPicture, field_levels

pytestmark = pytest.mark.slow  # seconds of flow


def test_levels_are_roots_the_first_row_is_the_uppermost_and_the_body_is_empty(wake):
    # 127 (0.8 / 5)^(1/2) = 50.8; the ends of the colours are 5.
    assert field_levels(np.array([[0.8, -0.8, 0.0, 5.0, -90.0]])).tolist() == [[51, -51, 0, 127, -127]]
    grid = wake.grid
    wake.flow.flat[:] = 0.0
    # -du/dy = -y: negative above the axis.
    wake.flow.faces_u[:] = 0.5 * grid.yc[None, :] ** 2
    picture = LevelPicture(wake)
    levels = picture.levels()
    assert picture.size == (levels.shape[1], levels.shape[0]) == (480, 180)
    left, right, low, high = picture.view
    assert (right - left) / 480 == pytest.approx((high - low) / 180)
    # In the free stream: the rows' centres are y, and the level is 127 (|y| / 5)^(1/2), rounded.
    y = high - (np.arange(180) + 0.5) * (high - low) / 180
    assert levels[:, -1] == pytest.approx(-127 * np.sign(y) * np.sqrt(np.abs(y) / 5.0), abs=2.0)
    base = round((wake.body.length - left) / (right - left) * 480)
    assert not levels[90 - 19 : 90 + 19, : base - 1].any()
    assert levels[90 - 19, base + 2] != 0
