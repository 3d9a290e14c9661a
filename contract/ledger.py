"""The drag ledger: the streamwise forces that the jets change, the lift, and the power of the jets.

A drag reduction must be compared with its cost. The controller reduces the drag force on the wall. The ledger also has
the forces on the slot faces, the reaction to the jets' momentum and the jets' power.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Final, Generic, TypeVar

from contract.arrays import Array

Value = TypeVar("Value", float, Array)
"""A value at one instant, or a time series of shape (n,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DragLedger(Generic[Value]):
    """The forces in units of rho U_inf^2 W / 2, at one instant or as time series. `Cd` and `Cl` act on the wall without
    the slot faces, on which the slot forces act. `Cd_momentum` is the reaction to the jets' momentum flux, negative for
    thrust. `jet_power` is the power that the jets transfer to the flow, in units of rho U_inf^3 W / 2."""

    Cd: Value
    Cl: Value
    Cd_slot_pressure: Value
    Cd_slot_viscous: Value
    Cd_momentum: Value
    jet_power: Value

    @property
    def Cd_slot(self) -> Value:
        """Sum of the pressure force and the viscous force on the slot faces."""
        return self.Cd_slot_pressure + self.Cd_slot_viscous

    @property
    def Cd_net(self) -> Value:
        """Sum of wall, slot and momentum forces: the total force of the flow on the vehicle."""
        return self.Cd + self.Cd_slot + self.Cd_momentum


LEDGER_FIELDS: Final = tuple(item.name for item in fields(DragLedger))
"""Names of the ledger's entries, in order, without the derived sums."""


def ledger_of(series: Mapping[str, Value]) -> DragLedger[Value]:
    """Build the ledger from named series; other series are ignored. Raises KeyError for a missing entry."""
    return DragLedger(**{name: series[name] for name in LEDGER_FIELDS})
