"""A film shows what the plant does: jets by their sign, the beginning of control, and drag counted by the story."""

from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pytest

from examples.film_of_a_run import BLOWING, CALM, SUCKING, Film, Story
from wake.truck.truck_wake import TruckWake

pytestmark = pytest.mark.slow  # figures are drawn

STORY = Story(begin=0.0, end=20.0, control=10.0, drag_before=1.0)


class Played:
    """The developed flow with samples of a test's making."""

    def __init__(self, wake: TruckWake) -> None:
        self._wake, self._said = wake, wake.sample()
        self._curl = wake.vorticity()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._wake, name)

    def vorticity(self) -> npt.NDArray[np.float64]:
        return self._curl

    def sample(self) -> Any:
        return self._said

    def says(self, t: float, *, drag: float = 1.0, share: float = 0.0) -> None:
        self._said = replace(self._said, t=t, Cd=drag, action=share * self._wake.config.action_limit)


@pytest.fixture
def played(wake) -> Played:
    return Played(wake)


def count(pixels: npt.NDArray[np.uint8], colour: str) -> int:
    wanted = 255.0 * np.array(mpl.colors.to_rgb(colour))
    return int((np.abs(pixels - wanted) < 3.0).all(axis=2).sum())


def test_the_frame_lights_up_when_control_begins_and_fades(played):
    film = Film(played, STORY, ("base_0",), 480)
    lit = []
    for t in (9.8, 10.0, 11.0, 14.0):
        played.says(t)
        film.record()
        pixels = film.pixels()
        assert pixels.shape == (240, 480, 3)
        # The left edge, halfway down the flow: beside the truck's flank.
        lit.append(count(pixels[20:50, :2], CALM))
    assert lit[1] == 60 and lit[0] == lit[2] == lit[3] == 0


def test_the_number_is_the_mean_of_a_cycle_under_control_only(played):
    film = Film(played, STORY, ("base_0",), 480)
    shown = []
    for t in np.arange(0.0, 18.01, 0.5):
        # Without control 1.3, which must not count; then 0.9 for 5 t_c, and 0.7.
        played.says(float(t), drag=1.3 if t < 10.0 else 0.9 if t <= 15.0 else 0.7)
        film.record()
        film.update()
        shown.append(film.figure.texts[0].get_text())
    assert set(shown[:30]) == {""}
    table = Film.palette()
    pixels = film.pixels().reshape(-1, 3)[::7] / 255.0
    assert len(table) <= 256, "a GIF has no more"
    assert np.abs(pixels[:, None] - table[None]).sum(axis=2).min(axis=1).mean() < 0.05
    # At 15 a cycle lies behind: -10 %. At 18 the last 5 t_c hold 4 of 0.9 and 6 of 0.7.
    assert shown[30] == "\N{MINUS SIGN}10 %"
    assert shown[36] == "\N{MINUS SIGN}22 %"


def test_the_jets_show_their_sign(played):
    film = Film(played, replace(STORY, control=0.0), ("base_0",), 960)
    for share, upper, lower in ((0.8, BLOWING, SUCKING), (-0.8, SUCKING, BLOWING)):
        played.says(5.0, share=share)
        flow = film.pixels()[: int(960 * 4.3 / 15.0)]
        above, below = flow[: len(flow) // 2], flow[len(flow) // 2 :]
        assert count(above, upper) > 300 and count(above, lower) == 0, share
        assert count(below, lower) > 300 and count(below, upper) == 0, share
    played.says(5.0)
    still = film.pixels()
    assert count(still[: len(flow)], BLOWING) == count(still, SUCKING) == 0
