"""The layout of wall-pressure sensors: names, positions, mirror images, and which sensors are on the base."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contract.arrays import Array, Index
from contract.errors import ConfigError
from contract.printable import MAX_NAME, is_name, quoted

SAME_PLACE: Final = 1e-4
"""Distance in W below which two positions count as equal. In the paper's own table, mirror images differ by 1e-5."""
FARTHEST: Final = 1000.0
"""Largest distance of a sensor from the front of the body, in W; a larger number is taken for a mistake."""
MAX_SENSORS: Final = 1_000
"""Largest number of sensors. It limits the time for comparing all pairs of sensors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorLayout:
    """The n sensors of a layout, in the order of a Cp array's columns. Raises ConfigError for a contradictory layout.

    Attributes:
        positions: positions (x, y) in the body's reference length W, x along the flow, y across it, (n, 2).
        base: columns of the sensors on the base; may be empty. The base pressure is the mean over these columns.
        mirror: column of each sensor's mirror image, (n,). In the mirrored flow (y -> -y) the readings are Cp[mirror].
            None if the sensors have no mirror images or the body is not symmetric.
    """

    names: tuple[str, ...]
    positions: Array
    base: Index
    mirror: Index | None

    def __post_init__(self) -> None:
        count = len(self.names)
        if not 0 < count <= MAX_SENSORS:
            raise ConfigError(f"the layout has {count} sensors: must have 1 to {MAX_SENSORS}")
        for name in self.names:
            if not is_name(name) or name != name.strip() or "," in name:
                right = f"must be 1 to {MAX_NAME} printable characters, without commas or spaces at its ends"
                raise ConfigError(f"sensor {quoted(name)}: {right}")
            if self.names.count(name) > 1:
                raise ConfigError(f"sensor {name!r}: two sensors have this name")
        if self.positions.shape != (count, 2) or not (np.abs(self.positions) <= FARTHEST).all():
            wanted = f"must be ({count}, 2) finite numbers within +-{FARTHEST:g} W"
            raise ConfigError(f"the sensor positions have shape {self.positions.shape}: {wanted}")
        first, second = np.nonzero(np.triu(_distance(self.positions, self.positions) < SAME_PLACE, 1))
        if first.size:
            one, other = self.names[first[0]], self.names[second[0]]
            raise ConfigError(f"sensors {one} and {other} have the same position: leave one of them out")
        if self.base.ndim != 1 or not ((self.base >= 0) & (self.base < count)).all():
            raise ConfigError(f"base sensors {self.base.tolist()}: must be a list of columns from 0 to {count - 1}")
        if self.mirror is not None:
            own_inverse = np.argsort(self.mirror, axis=None)
            if self.mirror.shape != (count,) or not np.array_equal(self.mirror, own_inverse):
                raise ConfigError("mirror images of the sensors: the image of each image must be the sensor itself")

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def of(
        cls, names: Sequence[str], positions: Array, *, base: Sequence[int] = (), symmetric: bool = True
    ) -> "SensorLayout":
        """Build a layout. If body and jets are `symmetric` about y = 0, the mirror images are found, if they exist."""
        positions = np.asarray(positions, dtype=np.float64)
        return cls(
            names=tuple(names),
            positions=positions,
            base=np.asarray(base, dtype=np.intp),
            mirror=_mirror(positions) if symmetric else None,
        )

    def without_partner(self) -> tuple[str, ...]:
        """Return the names of the sensors at (x, y) for which no sensor is at (x, -y)."""
        far = _distance(self.positions, self.positions * (1.0, -1.0)).min(axis=1) > SAME_PLACE
        return tuple(name for name, alone in zip(self.names, far, strict=True) if alone)

    def indices(self, names: Sequence[str]) -> Index:
        """Return the columns of named sensors. Raises ConfigError for a name that does not exist or is given twice."""
        for name in names:
            if name not in self.names:
                raise ConfigError(f"unknown sensor {name!r}: the sensors are {_listed(self.names)}")
        if len(set(names)) != len(names):
            raise ConfigError(f"a sensor is named twice in {list(names)}")
        return np.array([self.names.index(name) for name in names], dtype=np.intp)

    def only(self, columns: Index) -> "SensorLayout":
        """Return the layout of the sensors in these columns, without `mirror`, because mirror images may be missing."""
        return SensorLayout(
            names=tuple(self.names[column] for column in columns),
            positions=self.positions[columns],
            base=np.flatnonzero(np.isin(columns, self.base)),
            mirror=None,
        )

    def difference(self, other: "SensorLayout") -> str | None:
        """Describe the first difference between two layouts; None if they are equal."""
        if self.names != other.names:
            return f"names: {_listed(self.names)}, and {_listed(other.names)}"
        for name, here, there in zip(self.names, self.positions, other.positions, strict=True):
            if not (np.abs(here - there) < SAME_PLACE).all():
                return f"the position of {name}: {tuple(here.tolist())}, and {tuple(there.tolist())}"
        if not np.array_equal(self.base, other.base):
            return "the sensors on the base"
        if self.mirror is None or other.mirror is None:
            return None if self.mirror is other.mirror else "the mirror images"
        return None if np.array_equal(self.mirror, other.mirror) else "the mirror images"


def _mirror(positions: Array) -> Index | None:
    """Return for every sensor the column of the sensor at (x, -y). Return None if such a sensor is missing."""
    if positions.ndim != 2 or not len(positions):
        return None
    distance = _distance(positions, positions * (1.0, -1.0))
    partner = distance.argmin(axis=1)
    nearest = distance[np.arange(len(positions)), partner]
    if (nearest > SAME_PLACE).any() or len(set(partner.tolist())) != len(positions):
        return None
    return np.asarray(partner, dtype=np.intp)


def _distance(to: Array, start: Array) -> Array:
    """Return the distances between n positions and n starts, (n, n). A distance is the larger of |dx| and |dy|."""
    return np.asarray(np.abs(to[None, :, :] - start[:, None, :]).max(axis=2))


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 8 else f"{', '.join(names[:3])} .. {names[-1]} ({len(names)} in all)"
