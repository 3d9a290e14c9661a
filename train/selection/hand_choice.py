"""An engineer's choice, without data: mirror pairs at the rear edges, where the shear layers leave the body."""

from itertools import zip_longest

import numpy as np

from contract.arrays import Array, Mask
from contract.errors import ConfigError
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK


def select_by_hand(count: int, layout: SensorLayout = TRUCK) -> tuple[int, ...]:
    """Indices of `count` sensors, outward from the two rear corners.

    By turns the next pair along the sides, from the rear forward, and the next across the base, from its edges inward;
    when one of the two is used up, the other alone. On the truck, four are upper_39, lower_39, base_0 and base_9.
    Sensors on the symmetry line come last, from the rear forward. An odd count may end with the upper sensor of a pair,
    without its image. Raises ConfigError if the sensors have no mirror images, or none lies on a base.
    """
    mirror = layout.mirror
    if mirror is None or not layout.base.size:
        lacking = "mirror images" if mirror is None else "base"
        raise ConfigError(f"train.selection = 'hand': these sensors have no {lacking}; use another method or --sensors")
    x, y = layout.positions.T
    on_base = np.isin(np.arange(len(layout)), layout.base)
    paired = mirror != np.arange(len(layout))
    upper = paired & (y > 0)
    sides = _sorted(upper & ~on_base, -x)
    base = _sorted(upper & on_base, -y)
    pairs = [one for both in zip_longest(sides, base) for one in both if one is not None]
    chosen = [index for one in pairs for index in (one, int(mirror[one]))]
    return tuple([*chosen, *_sorted(~paired, -x)][:count])


def _sorted(wanted: Mask, by: Array) -> list[int]:
    """Columns that are wanted, the smallest of `by` first."""
    columns = np.flatnonzero(wanted)
    return [int(column) for column in columns[np.argsort(by[columns], kind="stable")]]
