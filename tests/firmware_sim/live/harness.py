"""A live session on a plant of two numbers with a controller that plans waves: everything else is the real thing."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from can_bridge.secoc.securing import authentication_in_virtual_time
from contract.arrays import Array
from contract.config.body import TRUCK_BODY
from contract.config.tree import Config
from contract.errors import LibraryError
from ecu.ecu import Ecu
from ecu.stepped import LoopEcu
from firmware_sim.live.loop.messages import PERIOD_COLUMNS, LiveAnswer
from firmware_sim.live.session import LiveSession
from tests.ecu.conftest import make_bundle
from tests.firmware_sim.bench.harness import LiveOscillator, Waves
from wake.plant.protocol import LoopPlant
from wake.solver.grid import truck_grid

CONFIG = Config()
_LACKS = {"mcu": "needs the extra mcu"}
CONTROLLERS, PLANTS = (
    tuple({"name": name, "label": name, "missing": _LACKS.get(name)} for name in names)
    for names in (("python", "c", "mcu", "off"), ("wake", "recording"))
)
LEAD_IN = 2.0  # t_c: ten periods


def oscillator(name: str) -> LoopPlant:
    return LiveOscillator(CONFIG)


class ShownOscillator(LiveOscillator):
    """Its flow turns counter-clockwise above the middle and clockwise below, in waves that move downstream."""

    grid = truck_grid()
    body = TRUCK_BODY

    def vorticity(self) -> Array:
        x, y = self.grid.xf[1:-1, None], self.grid.yf[None, 1:-1]
        return np.asarray(2.0 * np.sign(y) * (1.5 + np.sin(3.0 * (x - self.t))))


def shown(name: str) -> LoopPlant:
    return ShownOscillator(CONFIG) if name == "wake" else LiveOscillator(CONFIG)


class Live:
    def __init__(self, *, wake=oscillator, lead_in=LEAD_IN, config: Config = CONFIG, **more: Any) -> None:
        self.bundle = make_bundle()
        self.made: dict[str, Ecu] = {}
        self.refused: set[str] = set()
        self.clocks: list[str] = []  # the ECUs whose clock was set to 0
        self.controller = Waves()
        self.config = config
        more |= {"controllers": CONTROLLERS, "plants": PLANTS, "clock": iter(np.arange(10**6) / 40.0).__next__}
        self.session = LiveSession(bundle=self.bundle, config=config, wake=wake, ecu=self._ecu, lead_in=lead_in, **more)
        self.rows: dict[str, list[Any]] = {name: [] for name in PERIOD_COLUMNS}
        self.heard: dict[str, Any] = {}
        self.events: list[str] = []
        self.pictures: list[bytes] = []

    def _ecu(self, name: str) -> LoopEcu:
        if name in self.refused:
            raise LibraryError(f"no compiler\nfor {name}")
        assert name not in self.made
        ecu = self.made[name] = Ecu(
            self.bundle, self.controller, self.config, authentication=authentication_in_virtual_time(self.config.bus)
        )
        start_clock = partial(self.clocks.append, name)
        return LoopEcu(ecu=ecu, kind="python", computed_by=f"waves by {name}", start_clock=start_clock)

    def run(self, periods: int) -> "Live":
        for _ in range(periods):
            self.session.step()
            self.hear()
        return self

    def hear(self) -> None:
        for message in self.session.messages():
            if isinstance(message, bytes):
                self.pictures.append(message)
                continue
            if message["type"] == "periods":
                for name, values in message["columns"].items():
                    self.rows[name] += values
            elif message["type"] == "events":
                self.events += [item["text"] for item in message["items"]]
            self.heard[message["type"]] = message

    def ask(self, **request: Any) -> LiveAnswer:
        return self.session.handle(request)

    def set(self, **values: Any) -> "Live":
        answer = self.ask(set=values)
        assert "error" not in answer, answer
        return self

    @property
    def state(self) -> str:
        return str(self.heard["now"]["state"])


def make_shown(show: Callable[[str], None]) -> LiveSession:
    return Live(wake=shown).session
