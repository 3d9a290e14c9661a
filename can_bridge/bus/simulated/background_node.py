"""Other nodes' traffic on the simulated bus: periodic messages with random contents, for ever.

Each message has a clock of its own, as if a node of its own sent it: its phase against the loop moves in the course of
a run. With one clock for all, a run would meet one set of phases, lucky or not, again and again.
"""

from collections.abc import Iterable
from contextlib import suppress
from functools import partial
from random import Random
from typing import Final

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.bus.simulated.port import SimulatedPort
from can_bridge.timing.periodic_message import PeriodicMessage
from contract.errors import BusError

DRIFT_PPM: Final = 200
"""Between two quartz clocks of 100 ppm each."""


class BackgroundNode:
    """Sends each message at its offset and then at every period of its clock, late by up to its jitter.

    A frame that the bus does not take is lost; `SimulatedPort.refused` counts it.

    Args:
        bus: at the time from which the offsets count.
        seed: of contents, jitter and clocks. Every message draws from a sequence of its own, so that adding one leaves
            the others as they are.
        drift_ppm: clocks are slow by 0 to so much against the bus's time. None is fast: no period is shorter than its
            message has it, which the analysis of response times assumes.
    """

    def __init__(
        self,
        bus: SimulatedBus,
        port: SimulatedPort,
        messages: Iterable[PeriodicMessage],
        seed: int,
        *,
        drift_ppm: float = DRIFT_PPM,
    ) -> None:
        self._bus = bus
        self._port = port
        for message in messages:
            random = Random(f"{seed} {message.is_extended} {message.frame_id}")
            period_ns = message.period_ns + round(message.period_ns * random.uniform(0.0, drift_ppm) * 1e-6)
            self._plan(message, random, period_ns, bus.now_ns + message.offset_ns)

    def _plan(self, message: PeriodicMessage, random: Random, period_ns: int, due_ns: int) -> None:
        late_ns = random.randint(0, message.jitter_ns)
        self._bus.call_at(due_ns + late_ns, partial(self._send, message, random))
        next_ns = due_ns + period_ns
        self._bus.call_at(next_ns, partial(self._plan, message, random, period_ns, next_ns))

    def _send(self, message: PeriodicMessage, random: Random) -> None:
        with suppress(BusError):
            self._port.send(message.frame(random.randbytes(message.length)))
