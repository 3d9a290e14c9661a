"""Faults on the bus of a run, as a line of text each: `NODE:FAULT`.

    ecu:drop:probability=0.1@5..10       a tenth of what the ECU sends, from 5 s of the run until before 10 s
    vehicle:burst_loss:loss=0.1,mean_burst=5

NODE is the node whose port the fault is in, FAULT as `can_bridge.bus.faults.text` has it. Times are in s of the run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from can_bridge.bus.faults.fault import BusFault, FaultyBus, WrappedBus, wrap
from can_bridge.bus.faults.frame_faults import FlipBits, StuckAt
from can_bridge.bus.faults.node_faults import Babble, Disconnect
from can_bridge.bus.faults.text import parse_fault
from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError
from firmware_sim.runs.metadata import InjectedFault

NODES: Final = ("vehicle", "ecu")

NONE_BEFORE: Final[Mapping[str, int]] = MappingProxyType({})

LOOK_NS: Final = 1_000_000
"""Between two looks at the bus while there are faults: what a fault keeps becomes due without a frame on the bus."""


@dataclass(frozen=True, kw_only=True)
class NodeFault:
    """One fault of a run."""

    text: str
    node: str
    fault: BusFault


def parse_node_fault(text: str) -> NodeFault:
    """The fault that a text describes. Raises ConfigError naming the text, and what is not known, missing or out of its
    bounds."""
    node, colon, rest = text.partition(":")
    if not colon or node not in NODES:
        raise ConfigError(f"fault {text!r}: must begin with the node whose port it is in, vehicle: or ecu:")
    fault = parse_fault(rest)
    if isinstance(fault, Disconnect) and fault.kind == "device_gone":
        raise ConfigError(f"fault {text!r}: would end the run with an error; an open wire is `{node}:disconnect`")
    return NodeFault(text=text, node=node, fault=fault)


def check_faults(faults: Sequence[NodeFault], config: BusConfig, *, duration_s: float) -> None:
    """Raises ConfigError for a fault that could not act in a run of this length on this bus."""
    for one in faults:
        if one.fault.start_s >= duration_s:
            raise ConfigError(f"fault {one.text!r}: begins when the run has ended, after {duration_s:g} s")
        remakes = (isinstance(one.fault, FlipBits) and one.fault.before_crc) or (
            isinstance(one.fault, StuckAt) and one.fault.counter_runs
        )
        if remakes and config.key:
            raise ConfigError(f"fault {one.text!r}: makes frames of its own, which only the nodes can with bus.key")


class NodeFaults:
    """The faults of a run at work.

    Args:
        faults: of all nodes; those of one node from the wire to the node.
        bus: the run's, at time 0.
        before: how many faults of each node came before these.
    """

    def __init__(
        self, faults: Sequence[NodeFault], bus: SimulatedBus, seed: int, before: Mapping[str, int] = NONE_BEFORE
    ) -> None:
        self._faults = faults
        self._bus = bus
        self._seed = seed
        self._before = before
        self._ended = False
        self._ports: dict[str, FaultyBus] = {}
        self._babbling: list[_Babbling] = []
        if faults:
            self._look()

    def around(self, node: str, port: Bus) -> Bus:
        """The node's port with its faults; the port itself if it has none."""
        mine = [one.fault for one in self._faults if one.node == node]
        if not mine:
            return port
        # The same fault in both nodes must not strike at the same frames.
        seed = len(NODES) * self._seed + NODES.index(node)
        first = self._before.get(node, 0)
        faulty = self._ports[node] = wrap(port, mine, lambda: self._bus.now_ns, seed=seed, first=first)
        if not any(isinstance(one, Babble) for one in mine):
            return faulty
        self._babbling.append(_Babbling(faulty))
        return self._babbling[-1]

    def injected(self) -> tuple[InjectedFault, ...]:
        """What each has done so far, in the order given."""
        injectors = {node: iter(port.injectors) for node, port in self._ports.items()}
        return tuple(InjectedFault(text=one.text, acted=next(injectors[one.node]).acted) for one in self._faults)

    def end(self) -> None:
        """Look at the bus no more: the ports pass on what they are asked to, and nothing else."""
        self._ended = True

    def _look(self) -> None:
        if self._ended:
            return
        # Each look is also an event of the bus, after which the loop asks whether the ECU has its pressures.
        for port in self._babbling:
            port.look()
        self._bus.call_at(self._bus.now_ns + LOOK_NS, self._look)


class _Babbling(WrappedBus):
    """A port that is looked at between its node's calls, so that it babbles on; keeps what came for the node."""

    def __init__(self, port: Bus) -> None:
        super().__init__(port)
        self._kept: list[Frame] = []

    def look(self) -> None:
        self._kept += self._bus.receive_all()

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        frames, self._kept = [*self._kept, *self._bus.receive_all()], []
        return frames
