"""Faults in the ports of a run's nodes, each described by a line of text, `NODE:FAULT`.

    ecu:drop:probability=0.1@5..10       drops a tenth of the ECU's frames, from 5 s to just before 10 s
    vehicle:burst_loss:loss=0.1,mean_burst=5

NODE is the node whose port has the fault; `can_bridge.bus.faults.text` defines FAULT. Times are in s from the
run's start.
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
"""Time in ns between two events that this module adds to the bus, so that ports release delayed frames in time."""


@dataclass(frozen=True, kw_only=True)
class NodeFault:
    """One fault of a run, in one node's port."""

    text: str
    node: str
    fault: BusFault


def parse_node_fault(text: str) -> NodeFault:
    """Return the fault that a text describes. Raises ConfigError, which states the text and its faulty part."""
    node, colon, rest = text.partition(":")
    if not colon or node not in NODES:
        raise ConfigError(f"fault {text!r}: must begin with the node whose port has the fault, vehicle: or ecu:")
    fault = parse_fault(rest)
    if isinstance(fault, Disconnect) and fault.kind == "device_gone":
        raise ConfigError(f"fault {text!r}: would end the run with an error; an open wire is `{node}:disconnect`")
    return NodeFault(text=text, node=node, fault=fault)


def check_faults(faults: Sequence[NodeFault], config: BusConfig, *, duration_s: float) -> None:
    """Check the faults. Raises ConfigError for a fault that could not act in a run of this length on this bus."""
    for one in faults:
        if one.fault.start_s >= duration_s:
            raise ConfigError(f"fault {one.text!r}: begins after the end of the run, at {duration_s:g} s")
        remakes = (isinstance(one.fault, FlipBits) and one.fault.before_crc) or (
            isinstance(one.fault, StuckAt) and one.fault.counter_runs
        )
        if remakes and config.key:
            raise ConfigError(f"fault {one.text!r}: computes new frames, which needs the nodes' key if bus.key is set")


class NodeFaults:
    """Applies the faults of a run in the ports.

    Args:
        faults: faults of all nodes; of the faults of one node, the first is closest to the bus.
        bus: bus of the run, at time 0.
        before: number of random sequences that each node's port already uses before these faults.
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
        """Return the node's port with the node's faults added; return the port itself if the node has no faults."""
        mine = [one.fault for one in self._faults if one.node == node]
        if not mine:
            return port
        # Equal faults in both nodes must not affect the same frames, so the seed depends on the node.
        seed = len(NODES) * self._seed + NODES.index(node)
        first = self._before.get(node, 0)
        faulty = self._ports[node] = wrap(port, mine, lambda: self._bus.now_ns, seed=seed, first=first)
        if not any(isinstance(one, Babble) for one in mine):
            return faulty
        self._babbling.append(_Babbling(faulty))
        return self._babbling[-1]

    def injected(self) -> tuple[InjectedFault, ...]:
        """Return each fault with the number of times it has acted so far, in the order given."""
        injectors = {node: iter(port.injectors) for node, port in self._ports.items()}
        return tuple(InjectedFault(text=one.text, acted=next(injectors[one.node]).acted) for one in self._faults)

    def end(self) -> None:
        """Stop the periodic calls of the ports, whose faults then act only when a node uses its port."""
        self._ended = True

    def _look(self) -> None:
        if self._ended:
            return
        # Each call is also an event of the bus, after which the loop checks whether the ECU has received pressures.
        for port in self._babbling:
            port.look()
        self._bus.call_at(self._bus.now_ns + LOOK_NS, self._look)


class _Babbling(WrappedBus):
    """A port with a babbling fault, which also sends between the node's calls. Frames received meanwhile are stored for
    the node's next call."""

    def __init__(self, port: Bus) -> None:
        super().__init__(port)
        self._kept: list[Frame] = []

    def look(self) -> None:
        self._kept += self._bus.receive_all()

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        frames, self._kept = [*self._kept, *self._bus.receive_all()], []
        return frames
