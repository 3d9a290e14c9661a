"""The result of one attempt to send a frame (sent, unacknowledged, collided or destroyed), and a CAN controller's fault
confinement: its two error counters and three states.

`resolve` takes the senders and the wrong bits, and computes a verdict for each node and the number of bits that the
attempt occupies. `counted` applies a verdict to a node's error counters. Fault confinement follows ISO 11898-1:2015;
the rules have the numbers of the Bosch specification (CAN Specification 2.0, part B, chapter 8), which is free to read.
Rules 4 to 6 (bit errors in a flag, many dominant bits after a flag) are not simulated.
"""

from collections.abc import Collection, Mapping
from enum import Enum, auto
from typing import Final, NamedTuple

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.bus.simulated.port import SimulatedPort
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import SentBits, is_arbitration_bit, is_arbitration_stuff_bit, sent_bits

INTERMISSION: Final = 3
AFTER_ACKNOWLEDGE: Final = 8
"""Number of bits of the acknowledge delimiter and the end of frame."""
FLAG: Final = 6
"""Number of bits of an error flag."""
ERROR_FLAGS: Final = 12
"""Number of bits of an error flag and the flags that answer it, for every error except a missing acknowledgement. Other
nodes answer when the flag violates the rule of bit stuffing, at the latest after the flag's sixth bit."""
DELIMITER: Final = 8

PASSIVE_FROM: Final = 128
OFF_FROM: Final = 256
ERROR_STEP: Final = 8

_RECEIVE_LIMIT: Final = 255
"""Largest value of the receive error counter, here with 8 bits; the standard sets no largest value above 127."""
_AFTER_PASSIVE: Final = 127
"""Value to which a successful reception sets a receive error counter above 127; the standard allows 119 to 127."""


class AttemptVerdict(Enum):
    SENT = auto()
    HEARD = auto()
    TRANSMIT_ERROR = auto()
    UNACKNOWLEDGED = auto()
    """No node acknowledged the frame, and an error-passive sender saw no dominant bit during its error flag."""
    ARBITRATION_STUFF = auto()
    """A stuff bit of the sender was overwritten during arbitration. No node counts this error."""
    RECEIVE_ERROR = auto()
    SIGNALLED_FIRST = auto()
    """A receive error that no other node saw before this node's error flag, so this receiver may be faulty."""

    @property
    def is_senders(self) -> bool:
        """Whether the node was the transmitter. An error-passive transmitter waits longer before its next frame."""
        return self not in (AttemptVerdict.HEARD, AttemptVerdict.RECEIVE_ERROR, AttemptVerdict.SIGNALLED_FIRST)


def counted(health: BusHealth, verdict: AttemptVerdict) -> BusHealth:
    """Return a controller's health after an attempt, by rules 1 to 3 and 7 to 11. Bus-off lasts until the recovery."""
    tx_errors, rx_errors = health.tx_errors, health.rx_errors
    match verdict:
        case AttemptVerdict.SENT:  # rule 7
            tx_errors = max(tx_errors - 1, 0)
        case AttemptVerdict.HEARD:  # rule 8
            rx_errors = _AFTER_PASSIVE if rx_errors >= PASSIVE_FROM else max(rx_errors - 1, 0)
        case AttemptVerdict.TRANSMIT_ERROR:  # rule 3; ARBITRATION_STUFF is its second exception
            tx_errors += ERROR_STEP
        case AttemptVerdict.UNACKNOWLEDGED if health.state is not BusState.ERROR_PASSIVE:
            # The condition is the first exception of rule 3, with which a node alone on the bus never goes bus-off.
            tx_errors += ERROR_STEP
        case AttemptVerdict.RECEIVE_ERROR:  # rule 1
            rx_errors = min(rx_errors + 1, _RECEIVE_LIMIT)
        case AttemptVerdict.SIGNALLED_FIRST:  # rules 1 and 2
            rx_errors = min(rx_errors + 1 + ERROR_STEP, _RECEIVE_LIMIT)
    was_off = health.state is BusState.BUS_OFF
    state = BusState.ERROR_PASSIVE if max(tx_errors, rx_errors) >= PASSIVE_FROM else BusState.ERROR_ACTIVE
    if was_off or tx_errors >= OFF_FROM:
        state = BusState.BUS_OFF
    bus_off = health.bus_off + (state is BusState.BUS_OFF and not was_off)
    return BusHealth(state=state, tx_errors=tx_errors, rx_errors=rx_errors, bus_off=bus_off)


class AttemptOutcome(NamedTuple):
    """The outcome of one attempt to send a frame.

    Attributes:
        frame: frame that the nodes with the verdict HEARD receive.
        used: numbers of bits at the nominal and at the data bit rate, from the start of frame to its end or the error.
        rest: number of nominal bits from the last bit of `used` until the bus is free.
    """

    frame: Frame
    verdicts: Mapping[SimulatedPort, AttemptVerdict]
    used: tuple[int, int]
    rest: int


def resolve(
    frames: Mapping[SimulatedPort, Frame],
    receivers: Collection[SimulatedPort],
    *,
    misheard: Mapping[SimulatedPort, int],
    disturbed: int | None,
) -> AttemptOutcome:
    """Return the outcome of an attempt in which nodes start frames of equal priority at the same time.

    Args:
        receivers: all nodes that neither send nor are bus-off.
        misheard: position of the inverted bit, by receiver. Only this receiver sees this bit inverted.
        disturbed: position of the bit that all nodes see inverted. Positions are counted from the start of frame; a
            position after the end of frame means the last bit.
    """
    verdicts: dict[SimulatedPort, AttemptVerdict] = {}
    sent = {port: sent_bits(frame, error_passive=port.is_passive) for port, frame in frames.items()}
    senders, position = _collide(sent, verdicts)
    frame, bits = frames[senders[0]], sent[senders[0]]

    def destroyed(position: int, verdict: AttemptVerdict = AttemptVerdict.TRANSMIT_ERROR) -> AttemptOutcome:
        """Return the outcome of an error that every node detects sooner or later; the senders get `verdict`."""
        by_node = dict.fromkeys(receivers, AttemptVerdict.RECEIVE_ERROR) | dict.fromkeys(senders, verdict) | verdicts
        return AttemptOutcome(frame, by_node, bits.through(position), ERROR_FLAGS + DELIMITER + INTERMISSION)

    if position is not None:
        return destroyed(position)
    nominal, fast = bits.total
    last = nominal + fast - INTERMISSION - 1
    slot = last - AFTER_ACKNOWLEDGE
    heard = {port: AttemptVerdict.HEARD for port in receivers if port not in misheard}
    # A sending node does not acknowledge frames.
    acknowledged = any(misheard.get(port, last + 1) > slot for port in receivers)
    # The flag of an error-passive receiver is recessive, so no other node notices it.
    loud = {port: min(at, last) for port, at in misheard.items() if not port.is_passive}
    earliest = min(loud.values(), default=last + 1)
    everywhere = last + 1 if disturbed is None else min(disturbed, last)
    if min(everywhere, earliest) > (last if acknowledged else slot):
        verdict = AttemptVerdict.SENT if acknowledged else AttemptVerdict.UNACKNOWLEDGED
        verdicts |= dict.fromkeys(receivers, AttemptVerdict.RECEIVE_ERROR) | heard | dict.fromkeys(senders, verdict)
        if acknowledged:
            return AttemptOutcome(frame, verdicts, (nominal - INTERMISSION, fast), INTERMISSION)
        used = nominal - INTERMISSION - AFTER_ACKNOWLEDGE, fast
        return AttemptOutcome(frame, verdicts, used, FLAG + DELIMITER + INTERMISSION)
    if everywhere <= earliest:
        if everywhere < last:
            return destroyed(everywhere, _inverted(frame, bits, everywhere))
        # Receivers accept a frame one bit before its end. The sender repeats the frame, so the receivers get it twice.
        outcome = destroyed(last)
        return outcome._replace(verdicts={**outcome.verdicts, **heard})
    outcome = destroyed(earliest)
    first = [port for port, at in loud.items() if at == earliest]
    if all(port.is_passive for port in (*senders, *receivers) if port not in first):
        return outcome
    return outcome._replace(verdicts={**outcome.verdicts, **dict.fromkeys(first, AttemptVerdict.SIGNALLED_FIRST)})


def _collide(
    sent: Mapping[SimulatedPort, SentBits], verdicts: dict[SimulatedPort, AttemptVerdict]
) -> tuple[list[SimulatedPort], int | None]:
    """Return the remaining senders, and the position at which an error flag ends their frames; None for equal frames.
    At the first difference, a sender of a recessive bit has a bit error; if it is error-passive, others continue."""
    senders = list(sent)
    while len({sent[port].stuffed for port in senders}) > 1:
        columns = zip(*(sent[port].stuffed for port in senders), strict=False)
        position = next(k for k, values in enumerate(columns) if len(set(values)) > 1)
        recessive = [port for port in senders if sent[port].stuffed[position] == "1"]
        if not all(port.is_passive for port in recessive):
            return senders, position
        verdicts |= dict.fromkeys(recessive, AttemptVerdict.TRANSMIT_ERROR)
        senders = [port for port in senders if port not in recessive]
    return senders, None


def _inverted(frame: Frame, bits: SentBits, position: int) -> AttemptVerdict:
    """Return the verdict for a frame's sender if all nodes see the bit at `position` inverted."""
    if position < len(bits.stuffed) and bits.stuffed[position] == "1":
        if is_arbitration_stuff_bit(frame, position):
            return AttemptVerdict.ARBITRATION_STUFF
        if is_arbitration_bit(frame, position):
            # The sender has taken the wrong bit for a lost arbitration, so it is a receiver when the error is detected.
            return AttemptVerdict.RECEIVE_ERROR
    return AttemptVerdict.TRANSMIT_ERROR
