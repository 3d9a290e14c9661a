"""A flow whose inflow follows a vehicle's varying speed, with control and, for comparison, without control."""

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
from wake.plant.sample import Sample


@contextmanager
def driving(plant: Plant, drive: Drive, config: Config) -> Iterator[Drivable]:
    """Make the plant's inflow follow the drive from now on, while the block runs. The wake is scaled to the first
    speed, and adapts to it in the time without control. Raises ConfigError if the plant cannot change its speed."""
    if not isinstance(plant, Drivable):
        raise ConfigError(f"drive {drive.name}: this plant has a constant speed (`wake.plant.protocol.Drivable`)")
    wind, first = plant.wind, drive.speeds[0] / config.operating_point.speed
    plant.wind = drive.wind(config.operating_point, plant.t)
    try:
        if first != 1.0:
            plant.scale(first)
        yield plant
    finally:
        plant.wind = wind


def uncontrolled(plant: Plant, disturbing: Disturbing, config: Config, periods: int) -> Iterator[Sample]:
    """Run control periods with the jets shut, and yield the sample at the start of each period. Only the disturbances
    of the flow act. Raises PlantError if the flow diverges."""
    with disturbing.in_flow(plant):
        for k in range(periods):
            disturbing.set_flow(k * config.period_ns)
            sample = plant.sample()
            plant.advance_to(config.flow.substeps, 0.0)
            yield sample


def without_control(
    plant: Drivable, disturbing: Disturbing, config: Config, periods: int, progress: Callable[[int, int], None]
) -> dict[str, Array]:
    """Compute the series `WITHOUT` with shut jets; restore the state. `progress` gets (periods done, all periods)."""
    start, rows = plant.state(), np.empty((periods, len(WITHOUT)))
    for k, sample in enumerate(uncontrolled(plant, disturbing, config, periods)):
        rows[k] = sample.Cd, sample.Cd_net, sample.Cl
        progress(k + 1, periods)
    plant.reset(start)
    return dict(zip(WITHOUT, rows.T, strict=True))
