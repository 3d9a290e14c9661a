"""An ECU on a bus of python-can, in a thread and in real time."""

import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.isotp.endpoint import Endpoint
from contract.config.vehicle import BusConfig
from ecu.flashable.links import isotp_settings
from tests.can_bridge.tester.line import Ecu


class Fate:
    """What becomes of a frame: 0, 1 or 2 copies of it arrive."""

    def __init__(self, seed: int = 0, *, lost: float = 0.0, doubled: float = 0.0) -> None:
        self._random = random.Random(seed)
        self._lost, self._doubled = lost, doubled

    def copies(self) -> int:
        chance = self._random.random()
        return 0 if chance < self._lost else 2 if chance < self._lost + self._doubled else 1


@contextmanager
def served(ecu: Ecu, config: BusConfig, fate: Fate | None = None) -> Iterator[Callable[[], int]]:
    """Yields what counts the frames that have come."""
    fate = fate or Fate()
    stop, count, faults = Event(), [0], list[BaseException]()

    def run() -> None:
        try:
            with PythonCanBus.open(config, accept={config.diagnosis.request}) as bus:
                _pump(bus, ecu, config, fate, stop, count)
        except BaseException as error:  # noqa: BLE001  (the test fails by it below)
            faults.append(error)

    thread = Thread(target=run, daemon=True)
    thread.start()
    try:
        yield lambda: count[0]
    finally:
        stop.set()
        thread.join()
    assert faults == []


def _pump(bus: PythonCanBus, ecu: Ecu, config: BusConfig, fate: Fate, stop: Event, count: list[int]) -> None:
    endpoint = Endpoint(isotp_settings(config))
    while not stop.is_set():
        frame = bus.receive(0.002)
        now_ns = time.monotonic_ns()
        if frame is not None:
            count[0] += 1
            for _ in range(fate.copies()):
                endpoint.receive(now_ns, frame)
        answers = [answer for request in endpoint.take() for answer in ecu.server.request(now_ns, request)]
        for answer in answers + ecu.server.tick(now_ns):
            endpoint.send(answer)
        for sent in endpoint.poll(now_ns):
            for _ in range(fate.copies()):
                bus.send(sent)
        if ecu.is_reset:
            ecu.power_on()
