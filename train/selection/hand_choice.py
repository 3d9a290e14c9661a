"""An engineer's choice, without data: mirror pairs at the rear edges, where the shear layers leave the body."""

from contract import sensors


def select_by_hand(count: int) -> tuple[int, ...]:
    """Indices of `count` sensors, outward from the two rear corners.

    By turns the next pair along the sides, from the rear forward, and the next across the base, from its edges
    inward; when the base is full, the sides alone. Four are upper_39, lower_39, base_0 and base_9. No sensor lies on
    the symmetry line, so an odd count ends with the upper sensor of a pair, without its image.
    """
    mirror = sensors.mirror_permutation()
    sides = range(sensors.PER_SIDE - 1, -1, -1)
    base = range(sensors.BASE.start, sensors.BASE.start + sensors.ON_BASE // 2)
    uppers: list[int] = []
    for place, side in enumerate(sides):
        uppers += [side, *base[place : place + 1]]
    return tuple(index for upper in uppers for index in (upper, int(mirror[upper])))[:count]
