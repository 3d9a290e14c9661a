"""A flow on a drive: its stream follows the vehicle's speed, under control and, for comparison, without it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from contract.arrays import Array
from contract.config.tree import Config
from contract.errors import ConfigError
from firmware_sim.bench.disturbing import Disturbing
from firmware_sim.runs.run_log import WITHOUT
from wake.plant.drive import Drive
from wake.plant.protocol import Drivable, Plant


@contextmanager
def driving(plant: Plant, drive: Drive, config: Config) -> Iterator[Drivable]:
    """Let the stream have the drive's speed, from the plant's time on, which is the drive's 0.

    A developed wake is made that of the drive's first speed, and settles in the time without control. Raises
    ConfigError if the plant's stream has one speed.
    """
    if not isinstance(plant, Drivable):
        raise ConfigError(f"drive {drive.name}: this plant has one speed; a drive needs the own solver")
    wind, first = plant.wind, drive.speeds[0] / config.operating_point.speed
    if first != 1.0:
        plant.scale(first)
    plant.wind = drive.wind(config.operating_point, plant.t)
    try:
        yield plant
    finally:
        plant.wind = wind


def without_control(
    plant: Drivable, disturbing: Disturbing, config: Config, periods: int, progress: Callable[[int, int], None]
) -> dict[str, Array]:
    """The series of `WITHOUT` over so many periods with the jets shut; the plant is left where it was. Raises
    PlantError if the flow diverges.

    Args:
        disturbing: of the flow it takes what disturbs the run.
        progress: called with (periods done, periods in all) after every period.
    """
    start, rows = plant.state(), np.empty((periods, len(WITHOUT)))
    with disturbing.in_flow(plant):
        for k in range(periods):
            disturbing.set_flow(k * config.period_ns)
            sample = plant.sample()
            rows[k] = sample.Cd, sample.Cd_net, sample.Cl
            plant.advance_to(config.flow.substeps, 0.0)
            progress(k + 1, periods)
    plant.reset(start)
    return dict(zip(WITHOUT, rows.T, strict=True))
