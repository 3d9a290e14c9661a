"""A fault of the bus and one of a sensor that stillwake does not have (docs/reference/disturbances.md).

Around any port, simulated or real:

    port = wrap(bus.port("vehicle"), [EveryNth(n=3)], clock=lambda: bus.now_ns, seed=1)

and in a run, which takes a wake with other sensors as any plant:

    Simulation(bundle, config, spans=spans, disturbances=third_lost(3.0)).run(WithSensors(wake, clipped(0.25)))
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from random import Random
from typing import Annotated

import numpy as np

from can_bridge.bus.faults.fault import Change, SidedFault
from can_bridge.wire.frame import Frame
from contract.arrays import Array
from contract.config.rules import at_least
from contract.sensor_layout import SensorLayout
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.run_faults import NodeFault
from wake.plant.protocol import LoopPlant
from wake.plant.sample import Sample


@dataclass(frozen=True, kw_only=True)
class EveryNth(SidedFault, section="every_nth"):
    """Each n-th frame is lost, as in a gateway with too small a buffer. `acted` counts the lost."""

    n: Annotated[int, at_least(2)]

    def change(self, random: Random) -> Change:
        """See `SidedFault.change`. What is drawn comes from `random` alone, so that a run can be repeated."""
        passed = 0

        def change(frame: Frame) -> list[Frame]:
            nonlocal passed
            passed += 1
            return [] if passed % self.n == 0 else [frame]

        return change


def third_lost(start_s: float) -> Disturbances:
    """Each third frame of the vehicle is lost from a time of the run on; `text` is what the run's page calls it."""
    fault = NodeFault(text="vehicle:every_nth:n=3", node="vehicle", fault=EveryNth(n=3, start_s=start_s))
    return Disturbances(items=(fault,))


def clipped(limit: float) -> Callable[[Array], Array]:
    """Readings in Cp that an amplifier clips at the ends of its range."""
    return lambda readings: np.clip(readings, -limit, limit).astype(readings.dtype)


class WithSensors:
    """A plant whose sensors are faulty: the series of a run hold what they read. All else is the plant's."""

    def __init__(self, plant: LoopPlant, fault: Callable[[Array], Array]) -> None:
        self._plant, self._fault = plant, fault

    def sample(self) -> Sample:
        """Measure now, with the fault."""
        sample = self._plant.sample()
        return replace(sample, Cp=self._fault(sample.Cp))

    def advance_to(self, substep: int, action: float | None = None) -> None:
        """See `Plant.advance_to`."""
        self._plant.advance_to(substep, action)

    @property
    def layout(self) -> SensorLayout:
        """The plant's."""
        return self._plant.layout

    @property
    def description(self) -> str:
        """The plant's."""
        return self._plant.description
