from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.errors import ConfigError
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
        ((), np.zeros((0, 2)), (), "at least one"),
        (("a", "a"), np.zeros((2, 2)), (), "'a': named twice"),
        (("a", "b\x1b[2J"), np.zeros((2, 2)), (), "printable"),
        (("a", "b"), np.zeros((3, 2)), (), r"\(3, 2\): must be \(2, 2\)"),
        (("a", "b"), np.array([(0, 1), (0, np.nan)]), (), "finite"),
        (("a", "b"), np.array([(0, 1), (0, -1)]), (2,), "from 0 to 1"),
        (("a", "b"), np.array([(0, 1), (1e-5, 1)]), (), "a and b are at one place"),
    ]
    for names, places, base, message in wrong:
        with pytest.raises(ConfigError, match=message):
            SensorLayout.of(names, places, base=base)
    layout = SensorLayout.of("ab", np.array([(0.0, 1.0), (0.0, -1.0)]))
    assert layout.indices("ba").tolist() == [1, 0]
    with pytest.raises(ConfigError, match="unknown sensor 'c': there are a, b"):
        layout.indices("ac")
    with pytest.raises(ConfigError, match="twice"):
        layout.indices("aa")
