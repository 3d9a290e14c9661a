"""Several faults around one port."""

from collections.abc import Sequence
from random import Random
from typing import Any

from can_bridge.bus.faults.fault import Clock, Fault
from can_bridge.bus.faults.injector import Around, Injector
from can_bridge.bus.interface import Bus


class FaultyBus(Around):
    """A port with faults; made by `wrap`. `injectors` has one for each fault, in the order of the faults; read `acted`
    there."""

    def __init__(self, bus: Bus, injectors: Sequence[Injector[Any]]) -> None:
        super().__init__(injectors[-1] if injectors else bus)
        self.injectors = tuple(injectors)


def wrap(bus: Bus, faults: Sequence[Fault], clock: Clock, *, seed: int = 0, first: int = 0) -> FaultyBus:
    """The port with these faults around it.

    Args:
        faults: from the wire to the node: a received frame meets the first one first, a sent frame the last one.
        clock: the time in ns that the faults' spans refer to.
        seed: same faults, frames, times and seed: same outcome. Each fault draws from a generator of its own, so that
            the draws of one do not depend on what another does.
        first: place of the first fault, where others stand before it that were wrapped before.
    """
    injectors: list[Injector[Any]] = []
    for place, fault in enumerate(faults, first):
        random = Random(f"{seed} {place} {fault.section}")
        injectors.append(fault.around(injectors[-1] if injectors else bus, clock, random))
    return FaultyBus(bus, injectors)
