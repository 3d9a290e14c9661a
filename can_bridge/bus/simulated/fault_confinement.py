"""A CAN controller's fault confinement: its two counters and three states, as pure functions of a frozen value.

The source is ISO 11898-1:2015, fault confinement. The rules have the numbers of the Bosch specification (CAN
Specification 2.0, part B, chapter 8), which is free to read. Each function is one rule:

    1  `receive_error`         REC + 1   a receiver detects an error
    2  `dominant_after_flag`   REC + 8   a receiver sees a dominant bit right after its own error flag
    3  `transmit_error`        TEC + 8   a transmitter sends an error flag, with two exceptions
    4, 5, 6                              a flag that is not seen, or many dominant bits after it (not simulated)
    7  `transmitted`           TEC - 1   a frame was sent and acknowledged
    8  `received`              REC - 1   a frame was received without error; above 127, REC becomes 127
    9  `state`                           error-passive if one of the counters is 128 or more
    10 `state`                           bus-off if TEC is 256 or more
    11 `state`                           error-active again if both counters are below 128
    12 `recovered`                       error-active with both counters at 0 after 128 x 11 recessive bits (`RECOVERY`)
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
        """The controller's state according to rules 9 to 11."""
        if self.is_off:
            return BusState.BUS_OFF
        passive = max(self.tx_errors, self.rx_errors) >= PASSIVE_FROM
        return BusState.ERROR_PASSIVE if passive else BusState.ERROR_ACTIVE

    @property
    def health(self) -> BusHealth:
        """The controller's health, as the node's software reads it."""
        return BusHealth(state=self.state, tx_errors=self.tx_errors, rx_errors=self.rx_errors, bus_off=self.times_off)

    def receive_error(self) -> "FaultConfinement":
        """Apply rule 1: count a receive error."""
        return replace(self, rx_errors=min(self.rx_errors + 1, _RECEIVE_LIMIT))

    def dominant_after_flag(self) -> "FaultConfinement":
        """Apply rule 2: other nodes answered this receiver's error flag, so this receiver may have caused the error."""
        return replace(self, rx_errors=min(self.rx_errors + ERROR_STEP, _RECEIVE_LIMIT))

    def transmit_error(self) -> "FaultConfinement":
        """Apply rule 3. The rule's second exception, a recessive stuff bit of the identifier that is seen dominant,
        changes no counter."""
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
        """Apply rule 8: decrement REC after a reception without errors."""
        if self.rx_errors >= PASSIVE_FROM:
            return replace(self, rx_errors=_AFTER_PASSIVE)
        return replace(self, rx_errors=self.rx_errors - 1) if self.rx_errors else self

    def recovered(self) -> "FaultConfinement":
        """Apply rule 12: reset both counters after bus-off."""
        return FaultConfinement(times_off=self.times_off)
