"""The engineer's choice is symmetric and grows from the rear corners."""

import numpy as np
import pytest

from contract import sensors
from contract.errors import ConfigError
from contract.sensor_layout import SensorLayout
from train.selection.hand_choice import select_by_hand


def test_the_choice_is_symmetric_and_grows_from_the_rear_corners():
    assert [sensors.NAMES[index] for index in select_by_hand(4)] == ["upper_39", "lower_39", "base_0", "base_9"]
    for count in range(1, 91):
        chosen = select_by_hand(count)
        assert len(set(chosen)) == count
        image = set(np.array(sensors.TRUCK.mirror)[list(chosen)].tolist())
        assert len(set(chosen) - image) == count % 2, count
        assert count % 2 == 0 or set(chosen) - image == {chosen[-1]}
    # None left out is nearer to a corner along its own wall.
    corner = np.array([sensors.positions()[:, 0].max(), 0.5])
    position = np.abs(sensors.positions())
    distance = np.abs(position - corner).sum(axis=1)
    for count in range(2, 91, 2):
        inside = np.isin(np.arange(90), select_by_hand(count))
        for wall in (slice(0, 80), sensors.BASE):
            taken, left = distance[wall][inside[wall]], distance[wall][~inside[wall]]
            # The paper prints one base position a hundred-thousandth off its mirror image.
            assert not len(taken) or not len(left) or taken.max() < left.min() + 1e-4
    # Any symmetric body has a choice outward from its rear corners.
    names = ("nose", "roof", "floor", "top", "centre", "bottom")
    places = np.array([[0.0, 0.0], [0.8, 0.3], [0.8, -0.3], [1.0, 0.2], [1.0, 0.0], [1.0, -0.2]])
    layout = SensorLayout.of(names, places, base=(3, 4, 5))
    order = [names[index] for index in select_by_hand(6, layout)]
    assert order == ["roof", "floor", "top", "bottom", "centre", "nose"]
    for base, symmetric, message in (((3, 4, 5), False, "have no mirror images"), ((), True, "have no base")):
        with pytest.raises(ConfigError, match=f"'hand': these sensors {message}"):
            select_by_hand(2, SensorLayout.of(names, places, base=base, symmetric=symmetric))
