"""An ECU on a bus of python-can, in a thread and in real time."""

import random
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.isotp.endpoint import Endpoint
from contract.config.vehicle import BusConfig
from ecu.flashable.links import isotp_settings
from tests.can_bridge.flashing.store_ecu import StoreEcu


@contextmanager
def served(ecu: StoreEcu, config: BusConfig, *, lost: float = 0.0, doubled: float = 0.0) -> Iterator[Callable[[], int]]:
    """Yields what counts the frames that have come; frames are lost or doubled at these rates in both directions."""
    endpoint, rng = Endpoint(isotp_settings(config)), random.Random(1)
    stop, count = Event(), [0]

    def copies() -> int:
        chance = rng.random()
        return 0 if chance < lost else 2 if chance < lost + doubled else 1

    def turn(bus: PythonCanBus) -> None:
        frame = bus.receive(0.002)
        now_ns = time.monotonic_ns()
        if frame is not None:
            count[0] += 1
            for _ in range(copies()):
                endpoint.receive(now_ns, frame)
        answers = [answer for request in endpoint.take() for answer in ecu.server.request(now_ns, request)]
        for answer in answers + ecu.server.tick(now_ns):
            endpoint.send(answer)
        for sent in endpoint.poll(now_ns):
            for _ in range(copies()):
                bus.send(sent)
        if ecu.is_reset:
            ecu.power_on()

    def run() -> None:
        with PythonCanBus.open(config, accept={config.diagnosis.request}) as bus:
            while not stop.is_set():
                turn(bus)

    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(run)
        try:
            yield lambda: count[0]
        finally:
            stop.set()
        running.result()
