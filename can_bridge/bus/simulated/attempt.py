"""The result of one attempt to send a frame (sent, unacknowledged, collided or destroyed), and a CAN controller's fault
confinement: its two error counters and three states.

The functions are pure: from the senders and the wrong bits, they compute a verdict for each node, and the number of
bits that the attempt occupies. The source of fault confinement is ISO 11898-1:2015; the rules have the numbers of the
Bosch specification (CAN Specification 2.0, part B, chapter 8), which is free to read. Rules 4 to 6 (bit errors in a
flag, many dominant bits after a flag) are not simulated.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Final, Generic, NamedTuple, TypeVar

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import SentBits, is_arbitration_bit, is_arbitration_stuff_bit

INTERMISSION: Final = 3
AFTER_ACKNOWLEDGE: Final = 8
"""Number of bits of the acknowledge delimiter and the end of frame."""
FLAG: Final = 6
"""Number of bits of an error flag."""
ERROR_FLAGS: Final = 12
"""Number of bits of an error flag and the flags that answer it, for every error except a missing acknowledgement. The
answers begin when the flag violates the rule of bit stuffing, at the latest after its sixth bit."""
DELIMITER: Final = 8

T = TypeVar("T")

PASSIVE_FROM: Final = 128
OFF_FROM: Final = 256
ERROR_STEP: Final = 8
RECOVERY: Final = 128
"""Number of sequences of `RECESSIVE_BITS` recessive bits that end bus-off."""
RECESSIVE_BITS: Final = 11

_RECEIVE_LIMIT: Final = 255
"""Largest value of the receive error counter: 8 bits; the standard does not state how far it counts above 127."""
_AFTER_PASSIVE: Final = 127
"""Value of a receive error counter above 127 after a successful reception; the standard allows 119 to 127."""


@dataclass(frozen=True, kw_only=True)
class FaultConfinement:
    """A controller's error counters TEC and REC, whether it is bus-off, and its number of bus-offs since power-on."""

    tx_errors: int = 0
    rx_errors: int = 0
    is_off: bool = False
    times_off: int = 0

    @property
    def state(self) -> BusState:
        """The controller's state according to rules 9 to 11: bus-off, error-passive from 128 on, error-active."""
        if self.is_off:
            return BusState.BUS_OFF
        passive = max(self.tx_errors, self.rx_errors) >= PASSIVE_FROM
        return BusState.ERROR_PASSIVE if passive else BusState.ERROR_ACTIVE

    @property
    def health(self) -> BusHealth:
        return BusHealth(state=self.state, tx_errors=self.tx_errors, rx_errors=self.rx_errors, bus_off=self.times_off)

    def receive_error(self) -> "FaultConfinement":
        """Apply rule 1: a receiver that detects an error adds 1 to REC."""
        return replace(self, rx_errors=min(self.rx_errors + 1, _RECEIVE_LIMIT))

    def dominant_after_flag(self) -> "FaultConfinement":
        """Apply rule 2: add 8 to REC if other nodes answered the receiver's flag: the receiver may be at fault."""
        return replace(self, rx_errors=min(self.rx_errors + ERROR_STEP, _RECEIVE_LIMIT))

    def transmit_error(self) -> "FaultConfinement":
        """Apply rules 3 and 10: a sender of an error flag adds 8 to TEC, and is bus-off from 256 on. In the second
        exception of rule 3 (a recessive stuff bit of the identifier is seen dominant), no counter changes."""
        counted = self.tx_errors + ERROR_STEP
        goes_off = counted >= OFF_FROM and not self.is_off
        return replace(self, tx_errors=counted, is_off=self.is_off or goes_off, times_off=self.times_off + goes_off)

    def unacknowledged(self) -> "FaultConfinement":
        """Apply rule 3 with its first exception: no node acknowledged the frame, and no dominant bit was seen during
        the passive error flag. An error-passive node does not count this error, so a single node never goes bus-off."""
        return self if self.state is BusState.ERROR_PASSIVE else self.transmit_error()

    def transmitted(self) -> "FaultConfinement":
        """Apply rule 7: decrement TEC after an acknowledged transmission."""
        return replace(self, tx_errors=self.tx_errors - 1) if self.tx_errors else self

    def received(self) -> "FaultConfinement":
        """Apply rule 8: decrement REC after a reception without errors; above 127 it becomes 127."""
        if self.rx_errors >= PASSIVE_FROM:
            return replace(self, rx_errors=_AFTER_PASSIVE)
        return replace(self, rx_errors=self.rx_errors - 1) if self.rx_errors else self

    def recovered(self) -> "FaultConfinement":
        """Apply rule 12: reset both counters after `RECOVERY`."""
        return FaultConfinement(times_off=self.times_off)


class AttemptVerdict(Enum):
    SENT = auto()
    HEARD = auto()
    TRANSMIT_ERROR = auto()
    UNACKNOWLEDGED = auto()
    ARBITRATION_STUFF = auto()
    """A stuff bit of the sender was overwritten during arbitration. No node counts this error."""
    RECEIVE_ERROR = auto()
    SIGNALLED_FIRST = auto()
    """A receive error that no other node saw before this node's error flag."""

    def applied(self, faults: FaultConfinement) -> FaultConfinement:
        return _RULES[self](faults)

    @property
    def is_senders(self) -> bool:
        """Whether the node was the transmitter. An error-passive transmitter waits longer before its next frame."""
        return self not in (AttemptVerdict.HEARD, AttemptVerdict.RECEIVE_ERROR, AttemptVerdict.SIGNALLED_FIRST)


_RULES: Final[Mapping[AttemptVerdict, Callable[[FaultConfinement], FaultConfinement]]] = {
    AttemptVerdict.SENT: FaultConfinement.transmitted,
    AttemptVerdict.HEARD: FaultConfinement.received,
    AttemptVerdict.TRANSMIT_ERROR: FaultConfinement.transmit_error,
    AttemptVerdict.UNACKNOWLEDGED: FaultConfinement.unacknowledged,
    AttemptVerdict.ARBITRATION_STUFF: lambda faults: faults,
    AttemptVerdict.RECEIVE_ERROR: FaultConfinement.receive_error,
    AttemptVerdict.SIGNALLED_FIRST: lambda faults: faults.receive_error().dominant_after_flag(),
}


class Sender(NamedTuple, Generic[T]):
    """A node that won arbitration, its frame, and the frame's bits."""

    node: T
    frame: Frame
    bits: SentBits
    passive: bool


@dataclass(frozen=True, kw_only=True)
class AttemptOutcome(Generic[T]):
    """The outcome of one attempt to send a frame.

    Attributes:
        frame: frame that the nodes with the verdict HEARD receive; None if the frame did not reach its end.
        used: number of bits at the nominal bit rate and number of bits at the data bit rate, from the start of frame to
            the end of frame or to the error.
        rest: number of nominal bits from the last bit of `used` until the bus is free.
    """

    frame: Frame | None
    verdicts: Mapping[T, AttemptVerdict]
    used: tuple[int, int]
    rest: int


def resolve(
    senders: Sequence[Sender[T]], receivers: Mapping[T, bool], *, misheard: Mapping[T, int], disturbed: int | None
) -> AttemptOutcome[T]:
    """Return the outcome of an attempt in which the senders start frames of equal priority at the same time.

    Args:
        receivers: all other active nodes; the value states whether the node is error-passive.
        misheard: position of the wrong bit for each receiver that sees a wrong bit which no other node sees.
        disturbed: position of the bit that all nodes see inverted. Positions are counted from the start of frame; a
            position after the end of frame means the last bit.
    """
    verdicts: dict[T, AttemptVerdict] = {}
    senders, position = _collide(list(senders), verdicts)
    nodes, frame, bits = [sender.node for sender in senders], senders[0].frame, senders[0].bits

    def destroyed(position: int, verdict: AttemptVerdict = AttemptVerdict.TRANSMIT_ERROR) -> AttemptOutcome[T]:
        """Return the outcome of an error that every node detects sooner or later, with the senders' verdict."""
        by_node = dict.fromkeys(receivers, AttemptVerdict.RECEIVE_ERROR) | dict.fromkeys(nodes, verdict) | verdicts
        rest = ERROR_FLAGS + DELIMITER + INTERMISSION
        return AttemptOutcome(frame=None, verdicts=by_node, used=bits.through(position), rest=rest)

    if position is not None:
        return destroyed(position)
    nominal, fast = bits.total
    last = nominal + fast - INTERMISSION - 1
    slot = last - AFTER_ACKNOWLEDGE
    heard = {node: AttemptVerdict.HEARD for node in receivers if node not in misheard}
    # A sending node does not acknowledge frames.
    acknowledged = any(misheard.get(node, last + 1) > slot for node in receivers)
    # The flag of an error-passive receiver is recessive, so no other node notices it.
    loud = {node: min(at, last) for node, at in misheard.items() if not receivers[node]}
    earliest = min(loud.values(), default=last + 1)
    everywhere = last + 1 if disturbed is None else min(disturbed, last)
    if min(everywhere, earliest) > (last if acknowledged else slot):
        verdict = AttemptVerdict.SENT if acknowledged else AttemptVerdict.UNACKNOWLEDGED
        verdicts |= dict.fromkeys(receivers, AttemptVerdict.RECEIVE_ERROR) | heard | dict.fromkeys(nodes, verdict)
        if acknowledged:
            used = nominal - INTERMISSION, fast
            return AttemptOutcome(frame=frame, verdicts=verdicts, used=used, rest=INTERMISSION)
        used = nominal - INTERMISSION - AFTER_ACKNOWLEDGE, fast
        return AttemptOutcome(frame=None, verdicts=verdicts, used=used, rest=FLAG + DELIMITER + INTERMISSION)
    if everywhere <= earliest:
        if everywhere < last:
            return destroyed(everywhere, _inverted(frame, bits, everywhere))
        # Receivers accept a frame one bit before its end. The sender repeats the frame, so the receivers get it twice.
        outcome = destroyed(last)
        return replace(outcome, frame=frame, verdicts={**outcome.verdicts, **heard})
    outcome = destroyed(earliest)
    first = {node for node, at in loud.items() if at == earliest}
    answered = any(not sender.passive for sender in senders) or any(
        not passive for node, passive in receivers.items() if node not in first
    )
    if not answered:
        return outcome
    return replace(outcome, verdicts={**outcome.verdicts, **dict.fromkeys(first, AttemptVerdict.SIGNALLED_FIRST)})


def _collide(senders: list[Sender[T]], verdicts: dict[T, AttemptVerdict]) -> tuple[list[Sender[T]], int | None]:
    """Return the remaining senders, and the bit at which their frames end in an error flag; None for equal frames. At
    the first difference, the sender of a recessive bit has a bit error. If that node is error-passive, its flag is
    recessive and all other nodes continue."""
    while len({sender.bits.stuffed for sender in senders}) > 1:
        position = next(
            k for k, values in enumerate(zip(*(s.bits.stuffed for s in senders), strict=False)) if len(set(values)) > 1
        )
        recessive = [sender for sender in senders if sender.bits.stuffed[position] == "1"]
        if any(not sender.passive for sender in recessive):
            return senders, position
        for sender in recessive:
            verdicts[sender.node] = AttemptVerdict.TRANSMIT_ERROR
        senders = [sender for sender in senders if sender not in recessive]
    return senders, None


def _inverted(frame: Frame, bits: SentBits, position: int) -> AttemptVerdict:
    """Return the verdict for the sender of a frame whose bit at `position` all nodes see inverted."""
    if position < len(bits.stuffed) and bits.stuffed[position] == "1":
        if is_arbitration_stuff_bit(frame, position):
            return AttemptVerdict.ARBITRATION_STUFF
        if is_arbitration_bit(frame, position):
            # The sender has taken the wrong bit for a lost arbitration, so it is a receiver when the error is detected.
            return AttemptVerdict.RECEIVE_ERROR
    return AttemptVerdict.TRANSMIT_ERROR
