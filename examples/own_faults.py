"""A bus fault and a sensor fault that are not built into stillwake (docs/reference/disturbances.md).

The bus fault can be put around any port, simulated or real:

    port = wrap(bus.port("vehicle"), [EveryNth(n=3)], clock=lambda: bus.now_ns, seed=1)

Both faults can be used in a run, because a run accepts a wake with faulty sensors like any other plant:

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
from firmware_sim.bench.disturbances import Disturbances, NodeFault
from wake.plant.protocol import LoopPlant
from wake.plant.sample import Sample


@dataclass(frozen=True, kw_only=True)
class EveryNth(SidedFault, section="every_nth"):
    """A fault that loses every n-th frame, as a gateway with a small buffer does. A port counts them in `acted`."""

    n: Annotated[int, at_least(2)]

    def change(self, random: Random) -> Change:
        """Return the function that changes frames (see `SidedFault.change`). A fault takes all random numbers from
        `random`, so that a run can be repeated."""
        passed = 0

        def change(frame: Frame) -> list[Frame]:
            nonlocal passed
            passed += 1
            return [] if passed % self.n == 0 else [frame]

        return change


def third_lost(start_s: float) -> Disturbances:
    """Return the fault that loses every third frame of the vehicle from the time `start_s` on. The run's page shows the
    fault's `text`."""
    fault = NodeFault(text="vehicle:every_nth:n=3", node="vehicle", fault=EveryNth(n=3, start_s=start_s))
    return Disturbances(items=(fault,))


def clipped(limit: float) -> Callable[[Array], Array]:
    """Return a function that limits readings in Cp to +-`limit`, as an amplifier does at the ends of its range."""
    return lambda readings: np.clip(readings, -limit, limit).astype(readings.dtype)


class WithSensors:
    """A plant with faulty sensors. The series of a run contain the faulty readings."""

    def __init__(self, plant: LoopPlant, fault: Callable[[Array], Array]) -> None:
        self._plant, self._fault = plant, fault

    def sample(self) -> Sample:
        """Return the plant's present measurements, with the sensor fault applied."""
        sample = self._plant.sample()
        return replace(sample, Cp=self._fault(sample.Cp))

    def advance_to(self, substep: int, action: float | None = None) -> None:
        """Advance the plant; see `Plant.advance_to`."""
        self._plant.advance_to(substep, action)

    @property
    def layout(self) -> SensorLayout:
        """Layout of the plant's sensors."""
        return self._plant.layout

    @property
    def description(self) -> str:
        """Description of the plant."""
        return self._plant.description
