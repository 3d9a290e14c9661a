import numpy as np

from firmware_sim.ecu.window import History


def test_rows_are_oldest_first_and_as_many_as_the_window():
    history = History(length=3, bridge=1)
    for i in range(5):
        assert history.is_full == (i >= 3)
        history.append(np.array([i, 10.0 + i]), 0.1 * i)
    expected = [[2, 12, 0.2], [3, 13, 0.3], [4, 14, 0.4]]
    np.testing.assert_allclose(history.window(), expected)


def test_a_short_gap_repeats_the_pressures_with_the_action_of_its_own():
    history = History(length=2, bridge=2)
    history.repeat_last(0.5)  # nothing to repeat
    assert not history.is_full
    history.append(np.array([7.0]), 0.1)
    history.repeat_last(0.2)
    np.testing.assert_array_equal(history.window(), [[7.0, 0.1], [7.0, 0.2]])


def test_a_long_gap_empties_the_window():
    history = History(length=2, bridge=1)
    for gap, full in ((1, True), (1, True), (2, False)):
        history.append(np.array([1.0]), 0.0)
        history.append(np.array([2.0]), 0.0)
        for _ in range(gap):
            history.repeat_last(0.0)
        assert history.is_full == full
    history.append(np.array([3.0]), 0.0)
    np.testing.assert_array_equal(history.window(), [[3.0, 0.0]])
