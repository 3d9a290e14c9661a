"""What the linear model sees of a recording: differences of mirrored sensors, which are odd in the mirror image.

The mirror image of a flow (y -> -y) turns the sign of every such difference, of the action and of Cl. A linear model
without a constant term is odd as well, so it has this symmetry exactly, and mirror images add nothing to a fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.errors import DatasetError
from contract.recording.episode import Episode
from contract.sensor_layout import SensorLayout

SENSORS: Final = ("upper_39", "lower_39", "base_0", "base_9")
"""The truck's, in pairs: a place on the upper side, its mirror image; a place on the base, its mirror image."""
PROBE: Final = "Uy_probe"
"""The transverse velocity behind the body, which a plant may record and no vehicle measures."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """One stretch of recording.

    Attributes:
        rows: (n, p + 1), row k is (y_k, a_k): p differences in Cp, and the action in U_inf W from t_k on.
        responses: (n, q) of what is predicted with the differences, all odd in the mirror image.
    """

    rows: Array
    responses: Array

    def __len__(self) -> int:
        return len(self.rows)

    def part(self, start: int, stop: int) -> "Series":
        """Rows from `start` up to `stop`."""
        return Series(rows=self.rows[start:stop], responses=self.responses[start:stop])


def chosen_episodes(episodes: Sequence[Episode], patterns: Sequence[str]) -> tuple[Episode, ...]:
    """Episodes whose name matches one of the patterns, as in a shell. Raises DatasetError if none does; the message
    names those that there are."""
    chosen = tuple(item for item in episodes if any(fnmatchcase(item.name, pattern) for pattern in patterns))
    if not chosen:
        names = ", ".join(item.name for item in episodes)
        raise DatasetError(f"no episode is called {' or '.join(patterns)}: there are {names}")
    return chosen


def check_pairs(layout: SensorLayout, sensors: Sequence[str]) -> None:
    """Raise unless the sensors are pairs of mirror images, one after the other. Raises ConfigError if a name does
    not exist, or is given twice; DatasetError if two of a pair are not mirror images of each other; the message
    names them."""
    if layout.mirror is None:
        raise DatasetError("the sensors have no mirror images: a linear model is made of differences between such")
    if tuple(sensors) == SENSORS and SENSORS[0] not in layout.names:
        raise DatasetError("the data set is of another body than the truck: name pairs of its sensors with --sensors")
    columns = layout.indices(sensors)
    if len(sensors) < 2 or len(sensors) % 2:
        raise DatasetError(f"{len(sensors)} sensors: they must be pairs of mirror images")
    for first, second in zip(columns[::2], columns[1::2], strict=True):
        if layout.mirror[first] != second or first == second:
            raise DatasetError(
                f"sensors {layout.names[first]} and {layout.names[second]} are no pair: the mirror image of "
                f"{layout.names[first]} is {layout.names[layout.mirror[first]]}"
            )


def differences(pressures: Array) -> Array:
    """y (..., S/2) of pressures (..., S) at pairs of mirror images: first minus second."""
    return np.asarray(pressures[..., ::2] - pressures[..., 1::2])


def series_of(
    episode: Episode, layout: SensorLayout, sensors: Sequence[str], responses: Sequence[str], leave_out: int
) -> Series:
    """An episode's rows without its first ones. Raises DatasetError if the episode is not longer than what is left out,
    or lacks a series.

    Args:
        sensors: pairs of mirror images.
        leave_out: control steps at the beginning that are not used.
    """
    if len(episode) <= leave_out:
        raise DatasetError(
            f"episode {episode.name}: {len(episode)} steps, of which the first {leave_out} are left out: none is left"
        )
    for name in responses:
        if name not in episode.series:
            raise DatasetError(f"episode {episode.name}: the series {name!r} is missing; give it no weight")
    y = differences(episode.series["Cp"][:, layout.indices(sensors)])
    rows = np.column_stack([y, episode.series["action"]])
    predicted = np.stack([episode.series[name] for name in responses], axis=-1)
    return Series(rows=rows[leave_out:], responses=predicted[leave_out:])
