"""A film shows what the plant does: the beginning of control, and drag counted by the story."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pytest

from examples.film_of_a_run import CALM, Film, Story

pytestmark = pytest.mark.slow  # figures are drawn


def count(pixels: npt.NDArray[np.uint8], colour: str) -> int:
    wanted = 255.0 * np.array(mpl.colors.to_rgb(colour))
    return int((np.abs(pixels - wanted) < 3.0).all(axis=2).sum())


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
