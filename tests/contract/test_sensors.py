import numpy as np

from contract import sensors


def test_positions_are_the_papers_in_order_with_their_mirror_images():
    assert len(sensors.NAMES) == len(set(sensors.NAMES)) == sensors.COUNT == 90
    assert [sensors.NAMES[i] for i in (0, 39, 40, 79, 80, 89)] == [
        "upper_00", "upper_39", "lower_00", "lower_39", "base_0", "base_9",
    ]  # fmt: skip
    assert all(name.startswith("base_") for name in sensors.NAMES[sensors.BASE])
    # Figure 1's coordinates, in its own six digits.
    positions = sensors.positions()
    assert positions[[0, 1, 20, 39], 0].tolist() == [0.301634, 0.485268, 3.974317, 7.463366]
    assert positions[[80, 82, 89]].tolist() == [[7.647, 0.368182], [7.647, 0.204555], [7.647, -0.368182]]
    mirror = np.array(sensors.TRUCK.mirror)
    np.testing.assert_array_equal(sensors.TRUCK.base, np.arange(sensors.COUNT)[sensors.BASE])
    assert (mirror[mirror] == np.arange(sensors.COUNT)).all()
    # 1e-5: the paper's own coordinates on the base are not symmetric to the last digit.
    np.testing.assert_allclose(sensors.positions()[mirror], sensors.positions() * (1, -1), atol=1.01e-5)
