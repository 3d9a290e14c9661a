"""How much the chosen sensors repeat each other."""

from collections.abc import Sequence

import numpy as np

from contract.arrays import Array
from contract.errors import DatasetError
from contract.recording.dataset import Episode
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK


def correlation(episodes: Sequence[Episode], names: Sequence[str], layout: SensorLayout = TRUCK) -> Array:
    """Pearson correlation of the named sensors' pressures over all episodes together, (N, N).

    Raises:
        ConfigError: unknown or repeated sensor.
        DatasetError: if a sensor never changes; the message names it.
    """
    columns = layout.indices(names)
    pressure = np.concatenate([episode.series["Cp"][:, columns] for episode in episodes])
    for name, spread in zip(names, np.ptp(pressure, axis=0), strict=True):
        if spread == 0.0:
            raise DatasetError(f"sensor {name} is constant in all episodes: it has no correlation")
    return np.atleast_2d(np.corrcoef(pressure, rowvar=False))
