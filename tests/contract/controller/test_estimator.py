"""Views and hypotheses of the sensor estimator, and the past at another speed, against what is worked out by hand."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from contract.controller.estimator import EstimatorNetwork, Hypotheses, WindowView, estimator_shapes, pairs, views
from contract.controller.resampling import places


def test_views_leave_out_one_or_two_and_exchange_every_pair():
    for sensors, count in ((2, 2 + 1 + 2), (3, 3 + 3 + 9), (4, 4 + 6 + 24)):
        found = views(sensors)
        assert len(found) == len(set(found)) == count
        assert estimator_shapes(7, sensors) == {"window": (7, sensors + 1), "estimates": (count, sensors)}
    # An exchange moves the readings and leaves the action.
    assert WindowView((0,), (1, 3)).order(4) == [0, 3, 2, 1, 4]


def test_residuals_of_three_sensors_are_those_worked_out_by_hand():
    estimates = np.arange(15.0 * 3).reshape(15, 3)
    # Rows of `views(3)`: 0 1 2 leave out one; 3 4 5 leave out 01 02 12; then exchanged 01, 02, 12, three rows each.
    residuals = Hypotheses.of(3).residuals(np.array([100.0, 200.0, 300.0]), estimates)
    expected = [
        [100 - estimates[0, 0], 200 - estimates[3, 1], 300 - estimates[4, 2]],
        [100 - estimates[3, 0], 200 - estimates[1, 1], 300 - estimates[5, 2]],
        [100 - estimates[4, 0], 200 - estimates[5, 1], 300 - estimates[2, 2]],
        [200 - estimates[6, 0], 100 - estimates[7, 1], 300 - estimates[8, 2]],
        [300 - estimates[9, 0], 200 - estimates[10, 1], 100 - estimates[11, 2]],
        [100 - estimates[12, 0], 300 - estimates[13, 1], 200 - estimates[14, 2]],
    ]
    np.testing.assert_array_equal(residuals, expected)


def random_network(window: int = 5, sensors: int = 4, width: int = 9) -> EstimatorNetwork:
    rng = np.random.default_rng(1)
    sizes = (window * (sensors + 1) + sensors, width, width, sensors)
    layers = [(rng.normal(size=(b, a)) / a, rng.normal(size=b)) for a, b in pairwise(sizes)]
    mean = np.append(rng.normal(size=sensors), 0.0)
    return EstimatorNetwork(window=window, mean=mean, std=rng.uniform(0.5, 2.0, sensors + 1), layers=layers)


def test_no_estimate_is_built_on_what_its_view_leaves_out_and_an_exchange_undoes_one():
    network, window = random_network(), np.random.default_rng(2).normal(size=(5, 5))
    plain, place = network.estimates(window), {view: row for row, view in enumerate(views(4))}
    for view, row in place.items():
        spoiled = window.copy()
        # Exchanged readings stand in each other's columns.
        spoiled[:, [view.order(4)[j] for j in view.left_out]] = 1e6
        np.testing.assert_array_equal(network.estimates(spoiled)[row], plain[row])
    for pair in pairs(4):
        crossed = network.estimates(window[:, WindowView((), pair).order(4)])
        for j in range(4):
            np.testing.assert_array_equal(crossed[place[WindowView((j,), pair)]], plain[place[WindowView((j,))]])


@given(st.lists(st.floats(0.3, 2.0), min_size=2, max_size=60), st.integers(1, 40))
def test_rows_lie_whole_steps_of_travel_behind_the_newest(speeds: list[float], length: int) -> None:
    travelled = np.cumsum(speeds)
    found = places(speeds, length)
    behind, reach = travelled[-1] - found.of(travelled), travelled[-1] - travelled[0]
    # Sums of 60 speeds in two orders.
    np.testing.assert_allclose(behind, np.arange(len(behind))[::-1], atol=1e-12)
    assert len(behind) == length or reach - 1e-9 < len(behind) <= reach + 1.0 + 1e-9
    assert (found.newer - (found.share > 0.0)).min() >= 0


def test_at_the_design_speed_every_row_is_its_own() -> None:
    rows = np.random.default_rng(0).normal(size=(12, 3))
    found = places([1.0] * 12, 12)
    np.testing.assert_array_equal(found.of(rows), rows)
    assert len(places([1.0] * 12, 13).newer) == 12
