"""One more node on the simulated bus that sends periodic messages with random contents, for ever."""

from collections.abc import Iterable
from functools import partial
from random import Random

from can_bridge.bus.simulated import SimulatedBus
from can_bridge.bus.simulated_port import SimulatedPort
from can_bridge.bus.traffic import PeriodicMessage
from contract.errors import BusError


class BackgroundNode:
    """Sends each message at its offset and then at every period, late by up to its jitter.

    A frame that the bus does not take is lost; `SimulatedPort.refused` counts it.

    Args:
        bus: at the time from which the offsets count.
        port: of the node.
        messages: what it sends.
        seed: of contents and jitter. Every message draws from a sequence of its own, so that adding one leaves the
            others as they are.
    """

    def __init__(self, bus: SimulatedBus, port: SimulatedPort, messages: Iterable[PeriodicMessage], seed: int) -> None:
        self._bus = bus
        self._port = port
        for message in messages:
            random = Random(f"{seed} {message.is_extended} {message.frame_id}")
            self._plan(message, random, bus.now_ns + message.offset_ns)

    def _plan(self, message: PeriodicMessage, random: Random, due_ns: int) -> None:
        late_ns = random.randint(0, message.jitter_ns)
        self._bus.call_at(due_ns + late_ns, partial(self._send, message, random))
        self._bus.call_at(due_ns + message.period_ns, partial(self._plan, message, random, due_ns + message.period_ns))

    def _send(self, message: PeriodicMessage, random: Random) -> None:
        try:
            self._port.send(message.frame(random.randbytes(message.length)))
        except BusError:
            return
