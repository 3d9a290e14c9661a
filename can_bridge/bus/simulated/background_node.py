"""The traffic of other nodes on the simulated bus: periodic messages with random contents.

Each message has a separate clock, as if sent by a separate node, so that its phase relative to the control loop changes
during a run.
"""

from collections.abc import Iterable
from contextlib import suppress
from functools import partial
from random import Random
from typing import Final

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.bus.simulated.port import SimulatedPort
from can_bridge.timing.response_time import PeriodicMessage
from contract.errors import BusError

DRIFT_PPM: Final = 200
"""Largest drift in ppm between two quartz clocks whose errors are 100 ppm each."""


def send_background(
    bus: SimulatedBus,
    port: SimulatedPort,
    messages: Iterable[PeriodicMessage],
    seed: int,
    *,
    drift_ppm: float = DRIFT_PPM,
) -> None:
    """Let a node send periodic messages. Each message starts at its offset from now, repeats by its own clock, and is
    late by at most its jitter. `SimulatedPort.refused` counts the frames that the bus refuses.

    Args:
        seed: random seed of contents, jitter and clocks. Each message has an independent random sequence.
        drift_ppm: largest drift of the clocks. A clock is slower than the bus's time by a drift between 0 and this
            value. No clock is faster, because the response-time analysis assumes that no period is shorter than stated.
    """

    def plan(message: PeriodicMessage, random: Random, period_ns: int, due_ns: int) -> None:
        late_ns = random.randint(0, message.jitter_ns)
        bus.call_at(due_ns + late_ns, partial(send, message, random))
        next_ns = due_ns + period_ns
        bus.call_at(next_ns, partial(plan, message, random, period_ns, next_ns))

    def send(message: PeriodicMessage, random: Random) -> None:
        with suppress(BusError):
            port.send(message.frame(random.randbytes(message.length)))

    for message in messages:
        random = Random(f"{seed} {message.is_extended} {message.frame_id}")
        period_ns = message.period_ns + round(message.period_ns * random.uniform(0.0, drift_ppm) * 1e-6)
        plan(message, random, period_ns, bus.now_ns + message.offset_ns)
