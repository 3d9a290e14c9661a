"""A CAN controller's fault confinement: its two counters and three states, as pure functions of a frozen value.

The source is ISO 11898-1:2015, fault confinement. The rules have the numbers of the Bosch specification (CAN
Specification 2.0, part B, chapter 8), which is free to read. Each function is one rule. Rules 4 to 6, for a flag that
is not seen and for many dominant bits after it, are not simulated.
"""

from dataclasses import dataclass, replace
from typing import Final

from can_bridge.bus.interface import BusHealth, BusState

PASSIVE_FROM: Final = 128
OFF_FROM: Final = 256
ERROR_STEP: Final = 8
RECOVERY: Final = 128
"""Number of sequences of `RECESSIVE_BITS` recessive bits that end bus-off."""
RECESSIVE_BITS: Final = 11

_RECEIVE_LIMIT: Final = 255
"""Largest value of the receive error counter, which has 8 bits; the standard does not state how far it counts above
127."""
_AFTER_PASSIVE: Final = 127
"""Value of a receive error counter above 127 after a successful reception; the standard allows 119 to 127."""


@dataclass(frozen=True, kw_only=True)
class FaultConfinement:
    """A controller's error counters TEC and REC, whether it went bus-off and has not recovered, and how often it went
    bus-off since power-on."""

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
        """The controller's health, as the node's software reads it."""
        return BusHealth(state=self.state, tx_errors=self.tx_errors, rx_errors=self.rx_errors, bus_off=self.times_off)

    def receive_error(self) -> "FaultConfinement":
        """Apply rule 1: a receiver that detects an error adds 1 to REC."""
        return replace(self, rx_errors=min(self.rx_errors + 1, _RECEIVE_LIMIT))

    def dominant_after_flag(self) -> "FaultConfinement":
        """Apply rule 2: a receiver adds 8 if other nodes answered its flag, because it may have caused the error."""
        return replace(self, rx_errors=min(self.rx_errors + ERROR_STEP, _RECEIVE_LIMIT))

    def transmit_error(self) -> "FaultConfinement":
        """Apply rules 3 and 10: a sender of an error flag adds 8 to TEC, and is bus-off from 256 on. The second
        exception of rule 3, a recessive stuff bit of the identifier that is seen dominant, changes no counter."""
        counted = self.tx_errors + ERROR_STEP
        goes_off = counted >= OFF_FROM and not self.is_off
        return replace(self, tx_errors=counted, is_off=self.is_off or goes_off, times_off=self.times_off + goes_off)

    def unacknowledged(self) -> "FaultConfinement":
        """Apply rule 3 with its first exception: no node acknowledged the frame, and no dominant bit was seen during
        the passive error flag. The counter of an error-passive controller then does not change, so that a node alone on
        the bus never goes bus-off."""
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
