"""How many jet commands a vehicle may miss before it gives up control: an (m, k)-firm limit.

The ECU judges the pressures that it misses in the same way (`ecu.fail_safe`). It cannot see that its
commands are lost, so the vehicle judges these by itself.
"""

from dataclasses import dataclass, replace
from typing import Final

from can_bridge.wire.messages import Mode
from contract.config.vehicle import VehicleConfig

_NO_CONTROL: Final = (Mode.OFF, Mode.FAULT)


@dataclass(frozen=True, kw_only=True)
class CommandLosses:
    """Counts while the ECU has control, and latches at the limit.

    Attributes:
        window: latest periods that are judged together.
        limit: missed ones among them from which on control is given up.
        missed: of the latest periods under control, at most `window`, oldest first; none while the ECU has no control.
    """

    window: int
    limit: int
    missed: tuple[bool, ...] = ()
    is_latched: bool = False

    @classmethod
    def of(cls, config: VehicleConfig) -> "CommandLosses":
        """None so far."""
        return cls(window=config.loss_window, limit=config.loss_limit)

    def heard(self, mode: Mode) -> "CommandLosses":
        """After a period with a command of this mode."""
        return replace(self, missed=() if mode in _NO_CONTROL else (*self.missed, False)[-self.window :])

    def lost(self) -> "CommandLosses":
        """After a period without a command that can be used."""
        if not self.missed:
            return self
        missed = (*self.missed, True)[-self.window :]
        return replace(self, missed=missed, is_latched=self.is_latched or sum(missed) >= self.limit)

    def cleared(self) -> "CommandLosses":
        """Once the vehicle itself does not want control."""
        return replace(self, missed=(), is_latched=False)
