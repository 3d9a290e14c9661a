"""The drag ledger adds up, for one instant and for a series."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract import sensors
from contract.errors import ConfigError
from contract.ledger import ledger_of
from contract.sensor_layout import SensorLayout


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(1, 50)), min_size=1, max_size=12, unique=True), st.randoms())
def test_mirror_image_of_any_symmetric_layout_is_found(half, random):
    places = [(x, y) for x, y in half] + [(x, -y) for x, y in half]
    random.shuffle(places)
    layout = SensorLayout.of([f"s{i}" for i in range(len(places))], np.array(places) / 10.0)
    assert layout.mirror is not None
    np.testing.assert_array_equal(layout.positions[layout.mirror], layout.positions * (1.0, -1.0))


def test_layouts_differ_by_name_place_and_base():
    places = np.array([(0.0, 1.0), (0.0, -1.0)])
    layout = SensorLayout.of("ab", places)
    assert layout.difference(SensorLayout.of("ab", places)) is None
    for other, what in (
        (SensorLayout.of("ba", places), "names"),
        (SensorLayout.of("ab", places + 0.1), "position of a"),
        (SensorLayout.of("ab", places, base=[0]), "base"),
        (SensorLayout.of("ab", places, symmetric=False), "mirror"),
    ):
        assert what in str(layout.difference(other))
    layout = SensorLayout.of("abc", np.array([(0.0, 1.0), (0.0, -1.0), (1.0, 0.5)]))
    assert layout.mirror is None and layout.without_partner() == ("c",)


def test_layout_that_contradicts_itself_is_refused():
    wrong: list[tuple[Any, Any, Any, str]] = [
        ((), np.zeros((0, 2)), (), "must have 1 to 1000"),
        (("a", "a"), np.zeros((2, 2)), (), "'a': two sensors have this name"),
        (("a", "b\x1b[2J"), np.zeros((2, 2)), (), "printable"),
        (("a", "b"), np.zeros((3, 2)), (), r"\(3, 2\): must be \(2, 2\)"),
        (("a", "b"), np.array([(0, 1), (0, np.nan)]), (), "finite"),
        (("a", "b"), np.array([(0, 1), (0, -1)]), (2,), "from 0 to 1"),
        (("a", "b"), np.array([(0, 1), (0, -1)]), 1, "base sensors 1: must be a list of columns"),
        (("a", "b"), np.array([(0, 1), (1e-5, 1)]), (), "a and b have the same position"),
    ]
    for names, places, base, message in wrong:
        with pytest.raises(ConfigError, match=message):
            SensorLayout.of(names, places, base=base)
    layout = SensorLayout.of("ab", np.array([(0.0, 1.0), (0.0, -1.0)]))
    assert layout.indices("ba").tolist() == [1, 0]
    with pytest.raises(ConfigError, match="unknown sensor 'c': the sensors are a, b"):
        layout.indices("ac")
    with pytest.raises(ConfigError, match="twice"):
        layout.indices("aa")


def test_positions_are_the_papers_in_order_with_their_mirror_images():
    assert len(sensors.NAMES) == len(set(sensors.NAMES)) == sensors.COUNT == 90
    ends = ["upper_00", "upper_39", "lower_00", "lower_39", "base_0", "base_9"]
    assert [sensors.NAMES[i] for i in (0, 39, 40, 79, 80, 89)] == ends
    # Figure 1's coordinates, in its own six digits.
    positions = sensors.TRUCK.positions
    assert positions[[0, 1, 20, 39], 0].tolist() == [0.301634, 0.485268, 3.974317, 7.463366]
    assert positions[[80, 82, 89]].tolist() == [[7.647, 0.368182], [7.647, 0.204555], [7.647, -0.368182]]
    np.testing.assert_array_equal(sensors.TRUCK.base, np.arange(sensors.COUNT)[sensors.BASE])
    # 1e-5: the paper's own coordinates on the base are not symmetric to the last digit.
    np.testing.assert_allclose(positions[sensors.TRUCK.mirror], positions * (1, -1), atol=1.01e-5)


def test_the_ledger_adds_up_for_an_instant_and_a_series():
    values = {"Cd": 1.0, "Cl": -2.0, "Cd_slot_pressure": 0.25, "Cd_slot_viscous": -0.125, "Cd_momentum": -0.5}
    one = ledger_of({**values, "jet_power": 0.01, "t": 3.0})
    whole = ledger_of({name: np.full(5, value) for name, value in vars(one).items()})
    for found in (one, whole):
        assert np.all(found.Cd_slot == 0.125) and np.all(found.Cd_net == 0.625)
