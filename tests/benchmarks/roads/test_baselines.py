"""Tuning: the grid, then its neighbours, by a price that is known."""

import pytest

from benchmarks.roads.baselines import FORMULAS, Formula, judged, tuned
from benchmarks.roads.laws import Constant


def formula(scaled: tuple[str, tuple[float, ...]] | None) -> Formula:
    return Formula(
        title="one",
        make=lambda constants, config, release: Constant(action=constants["gain"]),
        grid=[{"gain": gain, "delay": delay} for gain in (-0.1, 0.1) for delay in (0.0, 6.0)],
        products=0,
        scaled=scaled,
    )


def test_the_neighbours_of_the_grid_s_best_are_tried_too():
    asked = []

    def price(constants):
        asked.append(dict(constants))
        return (constants["gain"] - 0.28) ** 2 + 0.01 * constants["delay"]

    best, second, *others = tuned(formula(("gain", (0.3, 3.0))), price, "one")
    assert best == {"gain": pytest.approx(0.3), "delay": 0.0} and len(others) + 2 == 6 == len(asked)
    assert second == {"gain": 0.1, "delay": 0.0}
    assert [one["gain"] for one in asked[4:]] == pytest.approx([0.03, 0.3])


def test_a_neighbour_that_is_worse_is_not_taken():
    ranked = tuned(formula(("gain", (3.0,))), lambda constants: abs(constants["gain"] - 0.1), "one")
    assert ranked[0] == {"gain": 0.1, "delay": 0.0} and len(ranked) == 5


def test_without_neighbours_the_grid_decides():
    ranked = tuned(formula(None), lambda constants: -constants["gain"] - constants["delay"], "one")
    assert ranked[0] == {"gain": 0.1, "delay": 6.0} and len(ranked) == 4


def test_a_bent_wake_is_dearer_than_a_straight_one_of_the_same_drag():
    straight = {"Cd": 0.8, "abs_Cl": 0.5, "mean_Cl": 0.0}
    assert judged(straight) == pytest.approx(0.85)
    assert judged({**straight, "mean_Cl": 0.5}) == pytest.approx(0.925)


@pytest.mark.parametrize("name", FORMULAS)
def test_every_constant_that_is_scaled_is_in_the_grid(name):
    found = FORMULAS[name]
    assert len({tuple(constants) for constants in found.grid}) == 1
    assert found.scaled is None or found.scaled[0] in found.grid[0]
