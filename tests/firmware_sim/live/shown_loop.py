"""The quick session with a flow that can be shown, as a server's process makes it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contract.arrays import Array
from contract.config.body import TRUCK_BODY
from firmware_sim.live import saving
from firmware_sim.live.session import LiveSession
from tests.firmware_sim.bench.harness import LiveOscillator
from tests.firmware_sim.live.harness import CONFIG, Live
from wake.plant.protocol import LoopPlant
from wake.solver.grid import truck_grid

RELEASES_GOAL = CONFIG.mpc.weights


class ShownOscillator(LiveOscillator):
    """Its flow turns counter-clockwise above the middle and clockwise below, in waves that move downstream."""

    grid = truck_grid()
    body = TRUCK_BODY

    def vorticity(self) -> Array:
        x, y = self.grid.xf[1:-1, None], self.grid.yf[None, 1:-1]
        return np.asarray(2.0 * np.sign(y) * (1.5 + np.sin(3.0 * (x - self.t))))


def plant(name: str) -> LoopPlant:
    """The recording has nothing to be shown."""
    return ShownOscillator(CONFIG) if name == "wake" else LiveOscillator(CONFIG)


@dataclass(frozen=True)
class MakeShown:
    """Picklable maker of one, whose saved runs have no pictures; `saves` is their folder."""

    saves: Path

    def __call__(self, show: Callable[[str], None]) -> LiveSession:
        for name in ("draw", "write_report"):
            setattr(saving, name, lambda *_: None)
        return Live(self.saves, wake=plant).session
