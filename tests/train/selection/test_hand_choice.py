"""The engineer's choice is symmetric and grows from the rear corners."""

import numpy as np

from contract import sensors
from train.selection.hand_choice import select_by_hand


def test_four_are_the_two_corners_from_both_sides():
    assert [sensors.NAMES[index] for index in select_by_hand(4)] == ["upper_39", "lower_39", "base_0", "base_9"]


def test_even_counts_are_their_own_mirror_image_and_odd_ones_lack_one():
    for count in range(1, 91):
        chosen = select_by_hand(count)
        assert len(set(chosen)) == count
        image = set(np.array(sensors.TRUCK.mirror)[list(chosen)].tolist())
        assert len(set(chosen) - image) == count % 2, count
        if count % 2:
            (alone,) = set(chosen) - image
            assert alone == chosen[-1]
            assert sensors.positions()[alone, 1] > 0


def test_none_left_out_is_nearer_to_a_corner_along_its_own_wall():
    corner = np.array([sensors.positions()[:, 0].max(), 0.5])
    position = np.abs(sensors.positions())
    distance = np.abs(position - corner).sum(axis=1)
    for count in range(2, 91, 2):
        inside = np.isin(np.arange(90), select_by_hand(count))
        for wall in (slice(0, 80), sensors.BASE):
            taken, left = distance[wall][inside[wall]], distance[wall][~inside[wall]]
            # The paper prints one base position a hundred-thousandth off its mirror image.
            assert not len(taken) or not len(left) or taken.max() < left.min() + 1e-4
